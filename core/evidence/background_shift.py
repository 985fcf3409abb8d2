"""Whether the background of a camera that should stand still has moved in its pictures.

Corners of the background are followed from one key frame's picture to another's by pyramidal Lucas-Kanade (J.-Y.
Bouguet, Pyramidal implementation of the Lucas Kanade feature tracker, Intel (2000)), there and back. Where the camera
moved, most of them are displaced by one similarity; where it did not, most of them stay, whatever else moves.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from ..numerics.arrays import Array, Bools

_MAX_CORNERS, _MIN_CORNERS = 200, 20
"""How many corners are followed at most, and how many tell something at least."""
_MIN_DISTANCE, _WINDOW, _LEVELS = 8, (21, 21), 4
"""Distance between corners and size of the window around each, pixels, and levels of the pyramid."""
_MARGIN = np.ones((15, 15), np.uint8)
"""Pixels around the performers that are left out: key poses are inexact, and corners have a neighbourhood."""
_STILL, _MAX_ERROR = 1.0, 1.5
"""Distances up to which a corner stays, and returns to its place or agrees with a similarity, pixels."""
_MIN_SHIFT = 2.0
"""Least median displacement of a camera that has moved, pixels of the reduced pictures."""
_MIN_SHARE, _MIN_EXTENT = 0.5, 0.25
"""Share of the corners that a similarity must explain for the camera to have moved, and of the picture that these must
enclose: before a plain wall, most corners are those of somebody who is not where the key poses are."""


@dataclass(frozen=True)
class BackgroundShift:
    """How far the background lies elsewhere in one picture than in another.

    Attributes
    ----------
    pixels : float
        Median displacement of its corners, pixels of the footage.
    frames : tuple of int
        The two frames, counted from the shot's first.
    """

    pixels: float
    frames: tuple[int, int]


def background_shift(
    pictures: Sequence[NDArray[np.uint8]], performers: Sequence[Bools], frames: Sequence[int], factor: float
) -> BackgroundShift | None:
    """Return the largest shift of the background between the first of some pictures and another; None if it stands
    still, or shows too few corners to tell.

    Parameters
    ----------
    pictures : sequence of K ndarray of uint8, shape (h, w, 3)
    performers : sequence of K ndarray of bool, shape (h, w)
        Where they are.
    frames : sequence of K int
        The pictures' frames, counted from the shot's first.
    factor : float
        Factor by which the pictures are reduced.
    """
    grey = [cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY) for picture in pictures]
    free = [cv2.dilate(mask.astype(np.uint8), _MARGIN) == 0 for mask in performers]
    shifts = [_shift(grey[0], grey[k], free[0] & free[k]) for k in range(1, len(grey))]
    found = [(shift, frame) for shift, frame in zip(shifts, frames[1:], strict=True) if shift is not None]
    if not found or max(found)[0] < _MIN_SHIFT:
        return None
    shift, frame = max(found)
    return BackgroundShift(factor * shift, (frames[0], frame))


def _shift(one: NDArray[np.uint8], other: NDArray[np.uint8], free: Bools) -> float | None:
    """Return the median displacement of the background between two pictures, pixels; 0 where most of it stays, None
    where too few corners or no common motion show it.
    """
    corners = cv2.goodFeaturesToTrack(one, _MAX_CORNERS, 0.01, _MIN_DISTANCE, mask=free.astype(np.uint8))
    if corners is None or len(corners) < _MIN_CORNERS:
        return None
    there, found, _ = cv2.calcOpticalFlowPyrLK(one, other, corners, None, winSize=_WINDOW, maxLevel=_LEVELS)
    back, returned, _ = cv2.calcOpticalFlowPyrLK(other, one, there, None, winSize=_WINDOW, maxLevel=_LEVELS)
    start, end = corners[:, 0], there[:, 0]
    kept = (found[:, 0] > 0) & (returned[:, 0] > 0) & (_lengths(back[:, 0] - start) < _MAX_ERROR)
    if kept.sum() < max(_MIN_CORNERS, _MIN_SHARE * len(corners)):
        return None
    start, end = start[kept], end[kept]
    moved = _lengths(end - start)
    if np.median(moved) < _STILL:
        return 0.0
    similarity, agreeing = cv2.estimateAffinePartial2D(start, end, ransacReprojThreshold=_MAX_ERROR)
    if similarity is None or agreeing.mean() < _MIN_SHARE:
        return None
    together = agreeing[:, 0] > 0
    if cv2.contourArea(cv2.convexHull(start[together])) < _MIN_EXTENT * one.size:
        return None
    return float(np.median(moved[together]))


def _lengths(vectors: Array) -> Array:
    return np.asarray(np.linalg.norm(vectors, axis=-1))
