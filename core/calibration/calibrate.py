"""Cameras from videos of an L-frame and a wand: find the balls, solve, correct the balls by the cameras, solve."""

from __future__ import annotations

import numpy as np

from ..shot import Progress
from .capture import Capture
from .film import Film, find_all
from .solve import Solution, solve

_FINDING = 0.8  # of the time
_SETTLED = 0.02  # pixels


def calibrate(film: Film, progress: Progress | None = None) -> Solution:
    """Solve for the cameras of what was filmed.

    The middle of a ball is not the centre of its outline, and how far it is off depends on the lens. Where the first
    solution shifts it by more than a fiftieth of a pixel from what was assumed, a second one follows.

    Raises
    ------
    FootageError, CalibrationError
        The videos do not serve; see `find_all`.
    CaptureError
        The capture does not tell; see `solve`.
    CancelledError
        `progress` returned False.
    """

    def part(start: float, end: float) -> Progress | None:
        if progress is None:
            return None
        return lambda what, fraction: progress(what, start + (end - start) * fraction)

    sightings = find_all(film, part(0.0, _FINDING))
    assumed = sightings.capture()
    solution = solve(assumed, part(_FINDING, 0.9))
    corrected = sightings.capture(solution.cameras)
    return solution if _shift(assumed, corrected) < _SETTLED else solve(corrected, part(0.9, 1.0))


def _shift(before: Capture, after: Capture) -> float:
    """How far the balls moved at most, pixels."""
    pairs = zip(before.views, after.views, strict=True)
    return max(float(np.abs(a.wand.points - b.wand.points).max(initial=0.0)) for a, b in pairs)
