"""Occlusion: which parts the cameras do not see, and when (paper 1, section 5.3)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..numerics.arrays import Array
from ..numerics.frame_ranges import runs

OCCLUDED_BELOW = 0.3
"""A part is occluded in a view where less than this share of its area is seen (paper 1, section 5.3)."""
LONG_GAP = 6
"""Number of frames out of sight from which on a part may be lost; prediction bridges shorter gaps."""


def occluded(share: Array, predicted: Array | None = None) -> NDArray[np.bool_]:
    """Return which parts count as occluded in a view; same shape as `share`.

    Parameters
    ----------
    share : ndarray, shape (..., P)
        Visible share of each part's projected area in its current pose, 0 to 1.
    predicted : ndarray, shape (..., P), optional
        The same in the pose predicted for the next frame; being occluded in either is enough.
    """
    hidden = share < OCCLUDED_BELOW
    return hidden if predicted is None else hidden | (predicted < OCCLUDED_BELOW)


def unseen(share: Array, predicted: Array | None = None) -> NDArray[np.bool_]:
    """Return which parts no view sees, shape (F, P), from visible shares (V, F, P); see `occluded`."""
    return occluded(share, predicted).all(axis=0)


def intervals(mask: NDArray[np.bool_], first: int = 0) -> list[list[int]]:
    """First and last frame of each run of true values in a mask (F,), whose frame 0 is frame `first`."""
    return [[first + a, first + b] for a, b in runs(mask)]
