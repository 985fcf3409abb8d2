"""Occlusion: which parts the cameras do not see, and when (paper 000, section 5.3)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

OCCLUDED_BELOW = 0.3
"""A part is occluded in a view where less than this share of its area is seen (paper 000, section 5.3)."""


def unseen(share: Array) -> NDArray[np.bool_]:
    """Frames on which no view sees a part, shape (F, P).

    Parameters
    ----------
    share : ndarray, shape (V, F, P)
        Visible share of each part's projected area, 0 to 1.
    """
    return (share < OCCLUDED_BELOW).all(axis=0)


def intervals(mask: NDArray[np.bool_], first: int = 0) -> list[list[int]]:
    """First and last frame of each run of true values; the mask's frame 0 is frame `first`."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], mask.astype(np.int8), [0]])))
    return [[first + int(a), first + int(b) - 1] for a, b in zip(edges[::2], edges[1::2], strict=True)]
