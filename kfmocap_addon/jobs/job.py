"""Work beside Blender, in a process of its own: Blender's window stays at hand, and what is given up ends at once."""

from __future__ import annotations

import contextlib
import pickle
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ...core.errors import CancelledError, KFMocapError

if TYPE_CHECKING:
    from ...core.runtime.progress import Progress

Work = Callable[["Progress"], Any]
"""Pickled to get there, and so is what it returns: a function of a module, or a `functools.partial` of one."""
_TELLING = 0.02
"""Share of the work after which the time that it took tells how long the rest will take."""


class Job:
    """A piece of work, a function of a progress callback, that goes on by itself until it is done or given up.

    Attributes
    ----------
    state : tuple of str and float
        What it does, and the share of it that is done.
    """

    def __init__(self, work: Work) -> None:
        self.state = ("", 0.0)
        self._begun = time.monotonic()
        self._cancelled = False
        self._outcome: tuple[str, Any] = ("error", KFMocapError("the work ended before its time"))
        head = sys.path, __package__.rsplit(".", 2)[0], str(Path(__file__).parents[2])
        sent = pickle.dumps(head) + pickle.dumps(work)
        flags = getattr(subprocess, "BELOW_NORMAL_PRIORITY_CLASS", 0) | getattr(subprocess, "CREATE_NO_WINDOW", 0)
        try:
            self._process = subprocess.Popen(
                [sys.executable, str(Path(__file__).with_name("worker.py"))],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                creationflags=flags,
            )
        except OSError as error:
            what = f"Blender's Python cannot be started: {error.strerror}"
            raise KFMocapError(what, where=sys.executable, todo="use the command line") from error
        self._thread = threading.Thread(target=self._listen, args=(sent,), daemon=True)
        self._thread.start()

    def _listen(self, sent: bytes) -> None:
        with contextlib.suppress(OSError, EOFError, pickle.UnpicklingError), self._process as process:
            process.stdin.write(sent)
            process.stdin.close()
            kind = "progress"
            while kind == "progress":
                kind, value = pickle.load(process.stdout)
                if kind == "progress":
                    self.state = value
            self._outcome = kind, value

    def cancel(self) -> None:
        """Give it up: its process ends at once."""
        self._cancelled = True
        self._process.kill()

    @property
    def done(self) -> bool:
        return not self._thread.is_alive()

    def told(self) -> str:
        """What it does, how far it is, and how long it will go on."""
        what, fraction = self.state
        text = f"{what.capitalize() or 'Starting'} {fraction:.0%}"
        if fraction < _TELLING:
            return text
        return f"{text}, {duration((time.monotonic() - self._begun) * (1 / fraction - 1))} left"

    def result(self) -> Any:
        """What the work returned; raises what it raised, or CancelledError where it was given up."""
        if self._cancelled:
            raise CancelledError
        kind, value = self._outcome
        if kind == "error":
            raise value
        return value


def duration(seconds: float) -> str:
    """A duration as one tells it: 8 s, 2:05 min, 1:02 h."""
    whole = max(0, round(seconds))
    if whole < 60:
        return f"{whole} s"
    minutes, unit = (whole, "min") if whole < 3600 else (whole // 60, "h")
    return f"{minutes // 60}:{minutes % 60:02d} {unit}"
