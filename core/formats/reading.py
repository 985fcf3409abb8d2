"""What all readers of files share: whatever a file contains, reading it returns its content or raises a KFMocapError.

Readers run inside `reading`, and check the sizes that a file states (lengths, depths, counts) before they allocate
memory.
"""

from __future__ import annotations

import csv
import struct
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import cv2
import numpy as np

from ..errors import KFMocapError, located

MAX_BYTES = 1 << 30
"""Largest file that is read; no legitimate file comes near."""
MAX_DEPTH = 100
"""Largest depth of nested lists and tables in a document."""
NUMBER_LIMIT = 1e9
"""Upper limit to all numbers that are read: metres, pixels, frames."""
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
"""Exceptions that Python and the libraries raise on damaged files."""
_SHOWN_CHARACTERS = 120


@contextmanager
def reading(path: Path, what: str, error: type[KFMocapError], todo: str | None = None) -> Iterator[None]:
    """Turn exceptions in the block into an error about a file.

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
        Of the given type, with the file's name; the block's own KFMocapErrors get the name if they lack it.
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
        reason = " ".join(f"{kind}{problem}".split())[:_SHOWN_CHARACTERS]
        raise error(f"is not {what}, or not whole: {reason}", where=str(path), todo=todo) from problem


def read_bytes(path: Path, what: str, error: type[KFMocapError]) -> bytes:
    """Read a file, which is called `what` in messages.

    Raises
    ------
    KFMocapError
        Of type `error`: the file cannot be read, is a folder or a device, or is larger than `MAX_BYTES`.
    """
    try:
        if path.exists() and not path.is_file():
            raise error(f"{what} cannot be read: it is not a file", where=str(path))
        if path.stat().st_size > MAX_BYTES:
            raise error(f"{what} cannot be read: it is larger than {MAX_BYTES >> 30} GB", where=str(path))
        return path.read_bytes()
    except (OSError, ValueError) as problem:
        reason = getattr(problem, "strerror", None) or problem
        raise error(f"{what} cannot be read: {reason}", where=str(path)[:_SHOWN_CHARACTERS]) from problem


def read_text(path: Path, what: str, error: type[KFMocapError]) -> str:
    """Read a text file in UTF-8, with or without a byte order mark; see `read_bytes`."""
    try:
        text = read_bytes(path, what, error).decode("utf-8-sig")
    except UnicodeDecodeError as problem:
        message = f"{what} cannot be read: it is not a text file in UTF-8"
        raise error(message, where=str(path), todo="save it in a text editor with that encoding") from problem
    return text.replace("\r\n", "\n").replace("\r", "\n")


def check_depth(text: str, path: Path, what: str, error: type[KFMocapError]) -> None:
    """Check that lists and tables of a YAML or JSON document are not nested deeper than `MAX_DEPTH`.

    Raises
    ------
    KFMocapError
        Of type `error`: they are. Brackets in strings are counted, too.
    """
    depth = np.cumsum([(c in "[{") - (c in "]}") for c in text if c in "[]{}"], dtype=np.int64)
    indented = max((len(line) - len(line.lstrip(" ")) for line in text.split("\n")), default=0)
    if depth.max(initial=0) > MAX_DEPTH or indented > 10 * MAX_DEPTH:
        raise error(f"is not {what}: it is nested too deeply", where=str(path))
