"""Smoothness of a segment's motion, with the poses that are known before and after it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ...body.motion import Motion, stacked
from ...body.smoothness import smoothness
from ...numerics.banded_blocks import BandedBlocks
from .problem import SegmentProblem

Array = NDArray[np.float64]


def segment_smoothness(
    problem: SegmentProblem, performer: int, motion: Motion, expected: Array | None = None
) -> BandedBlocks:
    """Normal equations of the accelerations of one performer's F poses.

    Parameters
    ----------
    problem : SegmentProblem
    performer : int
        Index of the performer.
    motion : Motion
        F poses.
    expected : ndarray, shape (F, D), optional
        Accelerations that cost nothing, in the middle of the frame before and the next; by default none.
    """
    before, after = problem.around(performer)
    known = stacked([m for m in (before, motion, after) if m is not None])
    start = 0 if before is None else 1
    beside = (start, len(known) - start - problem.length)
    precision = problem.precision(performer)
    if precision.ndim > 1:
        precision = np.pad(precision, (beside, (0, 0)), mode="edge")[1:-1]
    if expected is not None:
        expected = np.pad(expected, (beside, (0, 0)))[1:-1]
    return smoothness(known, precision, expected).cut(start, start + problem.length)
