"""Progress of a job: reported as it goes on, and the way to cancel it."""

from __future__ import annotations

from collections.abc import Callable

from ..errors import CancelledError

Progress = Callable[[str, float], bool]
"""progress(what, fraction) is called as a job goes on; it returns False to cancel."""


def report_progress(progress: Progress | None, what: str, fraction: float) -> None:
    """Tell how far a job is; raises CancelledError when the caller wants it to end."""
    if progress is not None and progress(what, fraction) is False:
        raise CancelledError
