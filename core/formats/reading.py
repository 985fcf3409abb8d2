"""One rule for all readers of files: whatever a file holds, reading it gives its content or an error of the project's.

Readers read within `reading`, and check what a file claims (lengths, depths, counts) before they make room for it.
"""

from __future__ import annotations

import csv
import struct
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TypeVar

import cv2
import numpy as np

from ..errors import KFMocapError, located

Name = TypeVar("Name")

MOST_BYTES = 1 << 30
"""Larger files are refused: none of those that are read here comes near."""
DEEPEST = 100
"""Levels of lists and tables within each other that a document may have."""
BEYOND = 1e9
"""Numbers that are larger than this stand for nothing that is measured here: metres, pixels, frames."""
_DAMAGE = (
    ArithmeticError,
    AttributeError,
    LookupError,
    MemoryError,
    RuntimeError,
    StopIteration,
    SyntaxError,
    TypeError,
    ValueError,
    cv2.error,
    csv.Error,
    struct.error,
)
"""What reading a damaged file leads to, in Python and in the libraries."""
_SHOWN = 120


@contextmanager
def reading(path: Path, what: str, error: type[KFMocapError], todo: str | None = None) -> Iterator[None]:
    """Turn whatever goes wrong in the block into an error about a file.

    Parameters
    ----------
    path : Path
    what : str
        What the file should be, such as "a TRC file".
    error : type
        The kind of error to raise.
    todo : str, optional
        What the user can do about a file that is not one.

    Raises
    ------
    KFMocapError
        Of that kind, with the file's name; those of the block are given its name where they lack it.
    """
    try:
        with np.errstate(all="ignore"):
            yield
    except KFMocapError as problem:
        if str(path) in str(problem):
            raise
        with located(str(path)):
            raise
    except OSError as problem:
        raise error(f"cannot be read: {problem.strerror or problem}", where=str(path)) from problem
    except RecursionError as problem:
        raise error(f"is not {what}: it is nested too deeply", where=str(path), todo=todo) from problem
    except _DAMAGE as problem:
        kind = "" if isinstance(problem, ValueError) else f"{type(problem).__name__} "
        reason = " ".join(f"{kind}{problem}".split())[:_SHOWN]
        raise error(f"is not {what}, or not whole: {reason}", where=str(path), todo=todo) from problem


def read_bytes(path: Path, what: str, error: type[KFMocapError]) -> bytes:
    """Read a file, which messages call `what`.

    Raises
    ------
    KFMocapError
        Of that kind: it cannot be read, is none (a folder, a device) or is larger than `MOST_BYTES`.
    """
    try:
        if path.exists() and not path.is_file():
            raise error(f"{what} cannot be read: it is not a file", where=str(path))
        if path.stat().st_size > MOST_BYTES:
            raise error(f"{what} cannot be read: it is larger than {MOST_BYTES >> 30} GB", where=str(path))
        return path.read_bytes()
    except (OSError, ValueError) as problem:
        reason = getattr(problem, "strerror", None) or problem
        raise error(f"{what} cannot be read: {reason}", where=str(path)[:_SHOWN]) from problem


def read_text(path: Path, what: str, error: type[KFMocapError]) -> str:
    """Read a text file in UTF-8, with or without a byte order mark; see `read_bytes`."""
    try:
        text = read_bytes(path, what, error).decode("utf-8-sig")
    except UnicodeDecodeError as problem:
        raise error(f"{what} cannot be read: it is not a text file in UTF-8", where=str(path)) from problem
    return text.replace("\r\n", "\n").replace("\r", "\n")


def first_repeated(names: Iterable[Name]) -> Name | None:
    """Return the first name that was there before, or None."""
    seen: set[Name] = set()
    for name in names:
        if name in seen:
            return name
        seen.add(name)
    return None


def check_depth(text: str, path: Path, what: str, error: type[KFMocapError]) -> None:
    """See that lists and tables of a document in YAML or JSON are not within each other without end.

    Raises
    ------
    KFMocapError
        Of that kind. Brackets within texts count, too: documents with so many of them are no better.
    """
    depth = np.cumsum([(c in "[{") - (c in "]}") for c in text if c in "[]{}"], dtype=np.int64)
    indented = max((len(line) - len(line.lstrip(" ")) for line in text.split("\n")), default=0)
    if depth.max(initial=0) > DEEPEST or indented > 10 * DEEPEST:
        raise error(f"is not {what}: it is nested too deeply", where=str(path))
