"""Standard streams of a program that must not fail because its messages cannot be printed."""

from __future__ import annotations

import io
import os
import sys
from typing import IO, TextIO


class LenientStream(io.TextIOWrapper):
    """A text stream that drops what cannot be written, because the disk is full or the terminal closed.

    Parameters
    ----------
    file : IO of bytes
    encoding : str
        Characters that it lacks are written as escape sequences.
    """

    def __init__(self, file: IO[bytes], encoding: str) -> None:
        super().__init__(file, encoding=encoding, errors="backslashreplace", line_buffering=True)

    def write(self, text: str) -> int:
        """Write a text."""
        try:
            return super().write(text)
        except OSError:
            return len(text)

    def flush(self) -> None:
        """Write what has not been written."""
        try:
            super().flush()
        except OSError:
            return

    def close(self) -> None:
        """Close it."""
        try:
            super().close()
        except OSError:
            return


def make_streams_safe() -> None:
    """Keep a program's printing from harming its results; to be called before it opens any file.

    Closed standard streams are replaced: their descriptors would be given to the next files, into which libraries would
    then print. Characters that the terminal lacks are written as escape sequences, and standard error becomes a
    `LenientStream`.
    """
    descriptor = os.open(os.devnull, os.O_RDWR)
    while descriptor <= 2:
        descriptor = os.open(os.devnull, os.O_RDWR)
    os.close(descriptor)
    if type(sys.stdout) is io.TextIOWrapper:
        # Undecodable bytes in a file's name are printed unchanged where possible.
        whole = sys.stdout.encoding.lower().replace("-", "") == "utf8"
        sys.stdout.reconfigure(errors="surrogateescape" if whole else "backslashreplace")
    if sys.stderr is None or (type(sys.stderr) is io.TextIOWrapper and _is_standard_error(sys.stderr)):
        encoding = "utf-8" if sys.stderr is None else sys.stderr.encoding
        sys.stderr = LenientStream(os.fdopen(2, "wb", closefd=False), encoding)


def _is_standard_error(stream: TextIO) -> bool:
    try:
        return stream.fileno() == 2
    except (OSError, ValueError):
        return False
