"""Eroding and dilating masks of pictures."""

from __future__ import annotations

import cv2
import numpy as np

from ...numerics.arrays import Bools

EDGE_WIDTH = 2
"""Width of a mask's edge in which pixels show something of both sides, pixels."""


def interior(mask: Bools, rim: int = EDGE_WIDTH) -> Bools:
    """Return a mask (h, w) eroded by some pixels."""
    return np.asarray(cv2.erode(mask.astype(np.uint8), _disc(rim)) > 0)


def outside(mask: Bools, margin: float) -> Bools:
    """Return which pixels are farther from a mask (h, w) than a margin, pixels."""
    far, box = np.ones(mask.shape, bool), box_around(mask, max(1, round(margin)))
    if mask[box].size:
        far[box] = cv2.dilate(mask[box].astype(np.uint8), _disc(margin)) == 0
    return far


def box_around(mask: Bools, margin: int) -> tuple[slice, slice]:
    """Return the rows and columns of a mask (h, w) that are set, and so many pixels beside them; none where none is."""
    return _span(mask.any(axis=1), margin), _span(mask.any(axis=0), margin)


def _span(those: Bools, margin: int) -> slice:
    found = np.flatnonzero(those)
    return slice(max(int(found[0]) - margin, 0), int(found[-1]) + 1 + margin) if len(found) else slice(0, 0)


def dilated(mask: Bools, distance: float) -> Bools:
    """Return which pixels are within a distance, which may be large, of a mask (h, w), pixels."""
    return np.asarray(cv2.distanceTransform((~mask).astype(np.uint8), cv2.DIST_L2, 3) <= distance)


def opened(mask: Bools, radius: float) -> Bools:
    """Return a mask (h, w) without details smaller than a disc with a radius, pixels (morphological opening)."""
    return np.asarray(cv2.morphologyEx(mask.astype(np.uint8), cv2.MORPH_OPEN, _disc(radius)) > 0)


def _disc(radius: float) -> cv2.typing.MatLike:
    size = 2 * max(1, round(radius)) + 1
    return cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (size, size))
