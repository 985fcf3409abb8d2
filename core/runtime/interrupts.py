"""Signals that ask a program to end: turned into exceptions, and held while results are put in place."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from types import FrameType
from typing import Any

ENDING = tuple(getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP", "SIGBREAK") if hasattr(signal, name))
"""The signals that ask a program to end and let it tidy up."""
WRITTEN = "the results had been written"
"""Note of an interrupt that came when they had."""
REPORT = "report.json"
"""Is among the results wherever they are a folder."""


class Interruptions:
    """While a command runs, signals that ask it to end raise KeyboardInterrupt, so that it tidies up.

    Signals that other code handles or ignores, as nohup does, are left alone; so are all of them outside the main
    thread, where Python cannot handle them.

    Attributes
    ----------
    received : int or None
        The first signal that came.
    """

    def __init__(self) -> None:
        self.received: int | None = None
        self._before: dict[int, Any] = {}

    def __enter__(self) -> Interruptions:
        if threading.current_thread() is threading.main_thread():
            for number in ENDING:
                if signal.getsignal(number) in (signal.SIG_DFL, signal.default_int_handler):
                    self._before[number] = signal.signal(number, self._interrupt)
        return self

    def __exit__(self, *_: object) -> None:
        for number, handler in self._before.items():
            signal.signal(number, handler)

    def _interrupt(self, number: int, _frame: FrameType | None) -> None:
        self.received = self.received or number
        raise KeyboardInterrupt

    @property
    def exit_code(self) -> int:
        """The exit code of a program that this signal ended: 130 for Ctrl-C, 143 for SIGTERM."""
        return 128 + (self.received or signal.SIGINT)


@contextmanager
def held_signals() -> Iterator[None]:
    """Hold signals that ask the program to end until the block is done; then they have their effect."""
    came: list[int] = []
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    # None stands for a handler that was not set from Python: it cannot be put back.
    numbers = [number for number in ENDING if signal.getsignal(number) is not None]
    before = {number: signal.signal(number, lambda n, _: came.append(n)) for number in numbers}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
        for number in came:
            signal.raise_signal(number)


@contextmanager
def results_are_written() -> Iterator[None]:
    """Mark an interrupt that comes in the block as one that came when the results were there already."""
    try:
        yield
    except KeyboardInterrupt as interrupt:
        interrupt.add_note(WRITTEN)
        raise


def results_seen(out: object) -> tuple[int, int] | None:
    """Say which results are there: another value before and after a run tells that it has put its own in place.

    Parameters
    ----------
    out : object
        The file that a command writes or the folder of its report.json, as a path; of anything else nothing is seen.

    Returns
    -------
    tuple of int, optional
        The file's number, and when it was written.
    """
    for file in (out / REPORT, out) if isinstance(out, Path) else ():
        with suppress(OSError, ValueError):
            if file.is_file():
                found = file.stat()
                return found.st_ino, found.st_mtime_ns
    return None


def interrupted_text(interrupt: BaseException, *, written: bool = False) -> str:
    """Say what an interrupt left.

    Parameters
    ----------
    interrupt : BaseException
        A note of a KeyboardInterrupt says what it left where that is neither all nor nothing.
    written : bool
        Its results are seen to be there.
    """
    notes: Sequence[str] = getattr(interrupt, "__notes__", ())
    if written or WRITTEN in notes:
        return f"interrupted when {WRITTEN}"
    partly = isinstance(interrupt, KeyboardInterrupt) and notes
    return f"interrupted: {notes[0]}" if partly else "interrupted, nothing was written"
