"""Signals that ask a program to end: they become exceptions, and are held while results are put in place."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from types import FrameType
from typing import Any

ENDING = tuple(getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP", "SIGBREAK") if hasattr(signal, name))
"""The signals that ask a program to end and let it clean up."""
WRITTEN_NOTE = "the results had been written"
"""Note added to an interrupt that came afterwards."""
REPORT_FILE = "report.json"
"""A file that is among the results whenever they are a folder."""


class Interruptions:
    """Makes signals that ask a command to end raise KeyboardInterrupt, so that it cleans up.

    Signals that other code handles or ignores, as nohup does, are left alone; so are all signals outside the main
    thread, where Python cannot handle them.

    Attributes
    ----------
    received : int or None
        The first signal received.
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
        """Exit code of a program ended by the signal received: 130 for Ctrl-C, 143 for SIGTERM."""
        return 128 + (self.received or signal.SIGINT)


@contextmanager
def held_signals() -> Iterator[None]:
    """Delay signals that ask the program to end until the block is done."""
    came: list[int] = []
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    # None stands for a handler that was not set from Python and cannot be restored.
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
    """Add the note `WRITTEN_NOTE` to an interrupt that comes in the block."""
    try:
        yield
    except KeyboardInterrupt as interrupt:
        interrupt.add_note(WRITTEN_NOTE)
        raise


def results_seen(out: object) -> tuple[int, int] | None:
    """Identify the results that are in place: the value changes when a run puts its own there.

    Parameters
    ----------
    out : object
        Path of the file that a command writes, or of the folder of its report.json; None is returned for anything else.

    Returns
    -------
    tuple of int, optional
        The file's inode number and modification time.
    """
    for file in (out / REPORT_FILE, out) if isinstance(out, Path) else ():
        with suppress(OSError, ValueError):
            if file.is_file():
                found = file.stat()
                return found.st_ino, found.st_mtime_ns
    return None


def interrupted_text(interrupt: BaseException, *, written: bool) -> str:
    """Return a message on what an interrupted run has written.

    Parameters
    ----------
    interrupt : BaseException
        The KeyboardInterrupt; if it has a note, that is what was written.
    written : bool
        Whether the results are in place.
    """
    notes: Sequence[str] = getattr(interrupt, "__notes__", ())
    if written or WRITTEN_NOTE in notes:
        return f"interrupted when {WRITTEN_NOTE}"
    partly = isinstance(interrupt, KeyboardInterrupt) and notes
    return f"interrupted: {notes[0]}" if partly else "interrupted, nothing was written"
