"""A progress bar on the terminal."""

from __future__ import annotations

import shutil
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from ..core.runtime.progress import Progress

_REDRAW_SECONDS = 0.1


@contextmanager
def progress_bar() -> Iterator[Progress | None]:
    """Provide a progress callback that draws a bar on standard error, or None if that is not a terminal."""
    if not sys.stderr.isatty():
        yield None
        return
    last = 0.0

    def draw(what: str, fraction: float) -> bool:
        nonlocal last
        now = time.monotonic()
        if now - last > _REDRAW_SECONDS or fraction >= 1:
            last = now
            width = max(10, shutil.get_terminal_size().columns - 30)
            done = round(width * min(max(fraction, 0.0), 1.0))
            bar = "#" * done + "." * (width - done)
            print(f"\r\x1b[K{what[:18]:18} [{bar}] {fraction:4.0%}", end="", file=sys.stderr, flush=True)
        return True

    try:
        yield draw
    finally:
        print("\r\x1b[K", end="", file=sys.stderr, flush=True)


def print_beside_bar(text: str) -> None:
    """Print a line on standard error while a bar may be drawn there."""
    bar = "\r\x1b[K" if sys.stderr.isatty() else ""
    print(f"{bar}{text}", file=sys.stderr, flush=True)
