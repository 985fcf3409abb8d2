"""Progress of a job: reporting it, dividing it among the job's parts, and cancelling."""

from __future__ import annotations

from collections.abc import Callable
from threading import Lock
from typing import TypeVar

from ..errors import CancelledError

Progress = Callable[[str, float], bool]
"""progress(what, fraction) is called while a job runs; it returns False to cancel."""

State = TypeVar("State")


def is_cancelled(answer: object) -> bool:
    """Whether a progress callback answered False: Python's, or NumPy's, as comparisons of its numbers are.

    Whatever else it returns, such as nothing or a 0, the job goes on.
    """
    return (isinstance(answer, bool) or str(getattr(answer, "dtype", "")) == "bool") and not answer


def report_progress(progress: Progress | None, what: str, fraction: float) -> None:
    """Report the progress of a job.

    Raises
    ------
    CancelledError
        `progress` returned False.
    """
    if progress is not None and is_cancelled(progress(what, fraction)):
        raise CancelledError


def share(progress: Progress | None, begin: float, end: float) -> Progress | None:
    """Return the callback for a part of a job that takes it from the fraction `begin` to `end`."""
    if progress is None:
        return None
    return lambda what, fraction: progress(what, begin + fraction * (end - begin))


class ParallelProgress:
    """Progress of a job whose parts are done at the same time, in any threads.

    Parameters
    ----------
    progress : callable, optional
        Called by one thread at a time.
    """

    def __init__(self, progress: Progress | None) -> None:
        self._progress = progress
        self._done: list[float] = []
        self._lock = Lock()

    def part(self, what: str, work: float) -> Callable[[float], None]:
        """Return a callback for the fraction done of a part, which is the fraction `work` of the job.

        It raises CancelledError where the job is cancelled.
        """
        place = len(self._done)
        self._done.append(0.0)

        def report(fraction: float) -> None:
            with self._lock:
                self._done[place] = max(self._done[place], fraction * work)
                report_progress(self._progress, what, min(sum(self._done), 1.0))

        return report


def step_share(
    on_step: Callable[[float, State], None] | None, begin: float, end: float
) -> Callable[[float, State], None] | None:
    """Return the same as `share` for a solver's callback, on_step(fraction, state)."""
    if on_step is None:
        return None
    return lambda fraction, state: on_step(begin + fraction * (end - begin), state)
