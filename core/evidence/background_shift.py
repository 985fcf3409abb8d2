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

_MAX_CORNERS, MIN_CORNERS = 200, 20
"""How many corners are followed at most, and how many tell something at least."""
_MIN_DISTANCE, _WINDOW, _LEVELS = 8, (21, 21), 4
"""Distance between corners and size of the window around each, pixels, and levels of the pyramid."""
_MARGIN = np.ones((15, 15), np.uint8)
"""Pixels around the performers that are left out: key poses are inexact, and corners have a neighbourhood."""
_STILL, MAX_ERROR = 1.0, 1.5
"""Distances up to which a corner stays, and returns to its place or agrees with a similarity, pixels."""
MIN_SHIFT = 2.0
"""Least median displacement of a camera that has moved, pixels of the reduced pictures."""
MIN_SHARE, _MIN_EXTENT = 0.5, 0.25
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
        The two frames.
    enlarged : float
        How much larger it is on the second of them.
    """

    pixels: float
    frames: tuple[int, int]
    enlarged: float = 1.0


def background_shift(
    pictures: Sequence[NDArray[np.uint8]], performers: Sequence[Bools], frames: Sequence[int], factor: float
) -> BackgroundShift | None:
    """Return the largest shift of the background between the first of some pictures and another; None if it stands
    still, or shows too few corners to tell. Parameters as of `background_shifts`.
    """
    return largest_shift(background_shifts(pictures, performers, frames, factor), factor)


def background_shifts(
    pictures: Sequence[NDArray[np.uint8]], performers: Sequence[Bools], frames: Sequence[int], factor: float
) -> list[BackgroundShift | None]:
    """Return how the background lies in each picture but the first, compared with that: by 0 pixels where it stands
    still, None where it shows too few corners to tell.

    Parameters
    ----------
    pictures : sequence of K ndarray of uint8, shape (h, w, 3)
    performers : sequence of K ndarray of bool, shape (h, w)
        Where they are.
    frames : sequence of K int
        The pictures' frames, in any count.
    factor : float
        Factor by which the pictures are reduced.
    """
    grey = [cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY) for picture in pictures]
    free, found = [beside(mask) for mask in performers], list[BackgroundShift | None]()
    for k in range(1, len(grey)):
        own = _shift(grey[0], grey[k], free[0] & free[k])
        found.append(None if own is None else BackgroundShift(factor * own[0], (frames[0], frames[k]), own[1]))
    return found


def largest_shift(shifts: Sequence[BackgroundShift | None], factor: float) -> BackgroundShift | None:
    """Return the largest of the shifts between a camera's pictures, reduced by a factor; None if it stood still."""
    largest = max((own for own in shifts if own is not None), key=lambda own: own.pixels, default=None)
    return largest if largest is not None and largest.pixels >= factor * MIN_SHIFT else None


def _shift(one: NDArray[np.uint8], other: NDArray[np.uint8], free: Bools) -> tuple[float, float] | None:
    """Return the median displacement of the background between two pictures, pixels, and how much larger it is on the
    second; 0 and 1 where most of it stays, None where too few corners or no common motion show it.
    """
    corners = background_corners(one, free)
    if corners is None:
        return None
    there, kept = followed(one, other, corners)
    if kept.sum() < max(MIN_CORNERS, MIN_SHARE * len(corners)):
        return None
    start, end = corners[kept, 0], there[kept]
    moved = _lengths(end - start)
    if np.median(moved) < _STILL:
        return 0.0, 1.0
    similarity, agreeing = cv2.estimateAffinePartial2D(start, end, ransacReprojThreshold=MAX_ERROR)
    if similarity is None or agreeing.mean() < MIN_SHARE:
        return None
    together = agreeing[:, 0] > 0
    if cv2.contourArea(cv2.convexHull(start[together])) < _MIN_EXTENT * one.size:
        return None
    return float(np.median(moved[together])), float(np.linalg.norm(similarity[:, 0]))


def beside(performers: Bools) -> Bools:
    """Return where a picture shows background, from where it shows performers."""
    return np.asarray(cv2.dilate(performers.astype(np.uint8), _MARGIN) == 0)


def background_corners(picture: NDArray[np.uint8], free: Bools) -> NDArray[np.float32] | None:
    """Return the pixels of corners of a grey picture's background, shape (n, 1, 2); None if there are too few."""
    corners = cv2.goodFeaturesToTrack(picture, _MAX_CORNERS, 0.01, _MIN_DISTANCE, mask=free.astype(np.uint8))
    return None if corners is None or len(corners) < MIN_CORNERS else np.asarray(corners, np.float32)


def followed(
    one: NDArray[np.uint8], other: NDArray[np.uint8], corners: NDArray[np.float32], guess: Array | None = None
) -> tuple[NDArray[np.float32], Bools]:
    """Return where corners (n, 1, 2) of one grey picture lie in another, (n, 2), and which are found there and back.

    `guess` (n, 2) is where they are expected.
    """
    given = None if guess is None else np.ascontiguousarray(guess[:, None], np.float32)
    flags = 0 if guess is None else cv2.OPTFLOW_USE_INITIAL_FLOW
    there, found, _ = cv2.calcOpticalFlowPyrLK(one, other, corners, given, None, None, _WINDOW, _LEVELS, flags=flags)
    home = None if guess is None else corners.copy()
    back, returned, _ = cv2.calcOpticalFlowPyrLK(other, one, there, home, None, None, _WINDOW, _LEVELS, flags=flags)
    kept = (found[:, 0] > 0) & (returned[:, 0] > 0) & (_lengths((back - corners)[:, 0]) < MAX_ERROR)
    return there[:, 0], kept


def _lengths(vectors: Array) -> Array:
    return np.asarray(np.linalg.norm(vectors, axis=-1))
