"""Progress of a job: reporting it, dividing it among the job's parts, and cancelling."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

from ..errors import CancelledError

Progress = Callable[[str, float], bool]
"""progress(what, fraction) is called while a job runs; it returns False to cancel."""

State = TypeVar("State")


def report_progress(progress: Progress | None, what: str, fraction: float) -> None:
    """Report the progress of a job.

    Raises
    ------
    CancelledError
        `progress` returned False.
    """
    if progress is not None and progress(what, fraction) is False:
        raise CancelledError


def share(progress: Progress | None, begin: float, end: float) -> Progress | None:
    """Return the callback for a part of a job that takes it from the fraction `begin` to `end`."""
    if progress is None:
        return None
    return lambda what, fraction: progress(what, begin + fraction * (end - begin))


def step_share(
    on_step: Callable[[float, State], None] | None, begin: float, end: float
) -> Callable[[float, State], None] | None:
    """Return the same as `share` for a solver's callback, on_step(fraction, state)."""
    if on_step is None:
        return None
    return lambda fraction, state: on_step(begin + fraction * (end - begin), state)
