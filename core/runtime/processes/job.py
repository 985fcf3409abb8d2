"""Jobs: work in a separate process, so that the program stays responsive and survives whatever happens to the work."""

from __future__ import annotations

import threading
import time
from typing import Any

from ...errors import CancelledError
from .worker_process import Work, WorkerProcess

_ESTIMATE_FROM = 0.02
"""Fraction of the work that must be done before the remaining time is estimated."""


class Job:
    """Work that runs in a separate process until it is done or cancelled.

    Attributes
    ----------
    state : tuple of str and float
        The stage of the work, and the fraction of it that is done.
    cancelled : bool

    Parameters
    ----------
    work : callable
    worker : WorkerProcess, optional
        An idle process, which stays alive afterwards. By default one is started for the job and ends with it.
    """

    def __init__(self, work: Work, worker: WorkerProcess | None = None) -> None:
        self.state = ("", 0.0)
        self._begun = time.monotonic()
        self.cancelled = False
        self._shown: dict[Any, Any] = {}
        self._lock = threading.Lock()
        self._outcome: Any = None
        self._error: Exception | None = None
        self._process, self._keeps = worker or WorkerProcess(), worker is not None
        self._thread = threading.Thread(target=self._wait_for, args=(work,), daemon=True)
        self._thread.start()

    def _wait_for(self, work: Work) -> None:
        try:
            self._outcome = self._process.call(work, self._tell, self._show)
        except Exception as error:
            self._error = error
        if not self._keeps:
            self._process.close()

    def _tell(self, state: tuple[str, float]) -> None:
        self.state = state

    def _show(self, key: Any, value: Any) -> None:
        with self._lock:
            self._shown[key] = value

    def take_shown(self) -> dict[Any, Any]:
        """Return the interim results since the last call, by their keys."""
        with self._lock:
            shown, self._shown = self._shown, {}
        return shown

    def cancel(self) -> None:
        """Stop the work by killing its process."""
        self.cancelled = True
        self._process.kill()

    def end(self, grace: float = 5.0) -> None:
        """Stop the work, and give its process some seconds to clean up."""
        self.cancelled = True
        self._process.end(grace)

    @property
    def process_id(self) -> int:
        """Id of the process that does the work."""
        return self._process.id

    @property
    def done(self) -> bool:
        """Whether the work has ended, in whatever way."""
        return not self._thread.is_alive()

    def status_text(self) -> str:
        """Return a message with the stage of the work, the fraction done, and the remaining time."""
        what, fraction = self.state
        text = f"{what[:1].upper()}{what[1:]}" if what else "Starting"
        text = f"{text} {fraction:.0%}"
        if fraction < _ESTIMATE_FROM:
            return text
        return f"{text}, {duration((time.monotonic() - self._begun) * (1 / fraction - 1))} left"

    def result(self) -> Any:
        """Return what the work returned; raises what it raised, or CancelledError if it was cancelled."""
        if self.cancelled:
            raise CancelledError
        if self._error is not None:
            raise self._error
        return self._outcome


def duration(seconds: float) -> str:
    """Format a duration: 8 s, 2:05 min, 1:02 h."""
    whole = max(0, round(seconds))
    if whole < 60:
        return f"{whole} s"
    minutes, unit = (whole, "min") if whole < 3600 else (whole // 60, "h")
    return f"{minutes // 60}:{minutes % 60:02d} {unit}"
