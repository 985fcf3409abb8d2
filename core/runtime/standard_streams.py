"""The standard streams of a program that must not fail because nobody can read what it says."""

from __future__ import annotations

import io
import os
import sys
from typing import IO, TextIO


class LenientStream(io.TextIOWrapper):
    """Text for people: what cannot be written, as the disk is full or the terminal is closed, is lost.

    Parameters
    ----------
    file : IO of bytes
    encoding : str
        Characters that it has not are written as their numbers.
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
    """See that what a program prints, and where it prints, cannot harm its results; called before it opens a file.

    A descriptor of a standard stream that is closed would be given to the next file, into which libraries would then
    print. Characters that the terminal has not are written as their numbers, and standard error is a `LenientStream`.
    """
    descriptor = os.open(os.devnull, os.O_RDWR)
    while descriptor <= 2:
        descriptor = os.open(os.devnull, os.O_RDWR)
    os.close(descriptor)
    if type(sys.stdout) is io.TextIOWrapper:
        # What is no text in a file's name goes out as it is, where that can be.
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
