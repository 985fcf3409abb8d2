"""A job: work in a process of its own. The program stays usable, and a job that is cancelled or dies harms no other."""

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

from ..errors import CancelledError, KFMocapError, WorkerEndedError

if TYPE_CHECKING:
    from .progress import Progress

Work = Callable[["Progress"], Any]
"""A function of a module, or a `functools.partial` of one: it and its result are pickled between the processes."""
_ESTIMATE_FROM = 0.02
"""Share of the work that must be done before the time that it took says how long the rest will take."""


class Job:
    """Work that runs in a process of its own until it is done or cancelled.

    Attributes
    ----------
    state : tuple of str and float
        What is being done, and the share of the work that is done.
    """

    def __init__(self, work: Work) -> None:
        self.state = ("", 0.0)
        self._begun = time.monotonic()
        self._cancelled = False
        self._outcome: tuple[str, Any] | None = None
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
            what = f"Python cannot be started: {error.strerror}"
            raise KFMocapError(what, where=str(sys.executable), todo="install the program again") from error
        self._thread = threading.Thread(target=self._listen, args=(sent,), daemon=True)
        self._thread.start()

    def _listen(self, sent: bytes) -> None:
        with contextlib.suppress(OSError, EOFError, pickle.UnpicklingError), self._process as process:
            assert process.stdin is not None and process.stdout is not None
            # It stays open: the worker ends when it is closed, as it is when this process ends, however that happens.
            process.stdin.write(sent)
            process.stdin.flush()
            kind = "progress"
            while kind == "progress":
                kind, value = pickle.load(process.stdout)
                if kind == "progress":
                    self.state = value
            self._outcome = kind, value

    def cancel(self) -> None:
        """Stop the work: its process ends at once."""
        self._cancelled = True
        self._process.kill()

    def end(self, grace: float = 5.0) -> None:
        """Stop the work and let its process tidy up, for some seconds at most."""
        self._cancelled = True
        self._process.terminate()
        try:
            self._process.wait(grace)
        except subprocess.TimeoutExpired:
            self._process.kill()

    @property
    def process_id(self) -> int:
        """Of the process that works."""
        return self._process.pid

    @property
    def done(self) -> bool:
        """Whether the work has ended, in whatever way."""
        return not self._thread.is_alive()

    def status_text(self) -> str:
        """Say what is being done, how much of it is done, and how long the rest will take."""
        what, fraction = self.state
        text = f"{what.capitalize() or 'Starting'} {fraction:.0%}"
        if fraction < _ESTIMATE_FROM:
            return text
        return f"{text}, {duration((time.monotonic() - self._begun) * (1 / fraction - 1))} left"

    def result(self) -> Any:
        """Return what the work returned; raises what it raised, or CancelledError where it was cancelled."""
        if self._cancelled:
            raise CancelledError
        if self._outcome is None:
            raise WorkerEndedError(self._process.wait())
        kind, value = self._outcome
        if kind == "error":
            raise value
        return value


def duration(seconds: float) -> str:
    """Format a duration: 8 s, 2:05 min, 1:02 h."""
    whole = max(0, round(seconds))
    if whole < 60:
        return f"{whole} s"
    minutes, unit = (whole, "min") if whole < 3600 else (whole // 60, "h")
    return f"{minutes // 60}:{minutes % 60:02d} {unit}"
