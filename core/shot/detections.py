"""What a detector found in one view: 2D keypoints of nameless people."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..numerics.arrays import Array


@dataclass(frozen=True, eq=False)
class Detections:
    """N detections of people in the footage of one view.

    Attributes
    ----------
    names : tuple of str, length L
        Names of the keypoints, without repetition, see `core.formats.keypoint_layouts`.
    frames : ndarray of int, shape (N,)
        The footage's frames, from 0, not decreasing.
    points : ndarray, shape (N, L, 2)
        Pixels of the footage as it was filmed, with lens distortion; NaN where a keypoint was not found.
    confidence : ndarray, shape (N, L)
        0 to 1; 0 where it was not found.
    tracks : ndarray of int, shape (N,)
        The detector's number of the person, the same from frame to frame; -1 if it gave none.
    skipped : tuple of str
        Messages about files that were left out because they could not be read.
    """

    names: tuple[str, ...]
    frames: NDArray[np.int64]
    points: Array
    confidence: Array
    tracks: NDArray[np.int64]
    skipped: tuple[str, ...] = ()

    def __len__(self) -> int:
        return len(self.frames)
