"""Catching FFmpeg's messages about damaged footage: OpenCV reads such frames without an error."""

from __future__ import annotations

import os
import re
import sys
import tempfile
from collections.abc import Iterable
from contextlib import suppress
from typing import IO, Self, TextIO

from .standard_streams import LenientStream

_MESSAGE_LINE = re.compile(rb"\[[\w,/]+ @ 0x[0-9a-f]+\] *(.*)")
"""A line of FFmpeg's: its component, and the message."""


class DecoderLog:
    """Collects FFmpeg's messages while footage is decoded within a `with` statement.

    Meanwhile the standard error of the whole process goes to a temporary file. Anything else in it is printed
    afterwards; Python's own `sys.stderr` is printed at once. If OPENCV_FFMPEG_LOGLEVEL is set, OpenCV prints FFmpeg's
    messages on the standard output, and none are caught.
    """

    def __init__(self) -> None:
        self.complaints: list[str] = []

    def __enter__(self) -> Self:
        self._file: IO[bytes] = tempfile.TemporaryFile("a+b", buffering=0)  # what is written comes after its end
        self._kept, self._python = os.dup(2), sys.stderr
        self._shown: TextIO | None = None
        if _writes_to(sys.stderr, 2):
            sys.stderr.flush()
            self._shown = sys.stderr = LenientStream(os.fdopen(os.dup(self._kept), "wb"), sys.stderr.encoding)
        os.dup2(self._file.fileno(), 2)
        self._read = 0
        return self

    def new(self) -> list[str]:
        """Return FFmpeg's messages since the last call."""
        lines = self._new_lines()
        self._show(line for line in lines if not _MESSAGE_LINE.match(line))
        messages = [m[1].decode(errors="replace").strip() for m in map(_MESSAGE_LINE.match, lines) if m]
        self.complaints += messages
        return messages

    def __exit__(self, *_: object) -> None:
        os.dup2(self._kept, 2)
        if self._shown is not None:
            sys.stderr = self._python
            self._shown.close()
        self.new()
        os.close(self._kept)
        self._file.close()

    def _new_lines(self) -> list[bytes]:
        self._file.seek(self._read)
        data = self._file.read()
        self._read += len(data)
        return data.splitlines(keepends=True)

    def _show(self, lines: Iterable[bytes]) -> None:
        for line in lines:
            with suppress(OSError):
                os.write(self._kept, line)


def _writes_to(stream: TextIO | None, descriptor: int) -> bool:
    try:
        return stream is not None and stream.fileno() == descriptor
    except (OSError, ValueError):  # pytest and Blender replace the streams
        return False
