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
    return np.asarray(cv2.dilate(mask.astype(np.uint8), _disc(margin)) == 0)


def dilated(mask: Bools, distance: float) -> Bools:
    """Return which pixels are within a distance, which may be large, of a mask (h, w), pixels."""
    return np.asarray(cv2.distanceTransform((~mask).astype(np.uint8), cv2.DIST_L2, 3) <= distance)


def opened(mask: Bools, radius: float) -> Bools:
    """Return a mask (h, w) without details smaller than a disc with a radius, pixels (morphological opening)."""
    return np.asarray(cv2.morphologyEx(mask.astype(np.uint8), cv2.MORPH_OPEN, _disc(radius)) > 0)


def _disc(radius: float) -> cv2.typing.MatLike:
    size = 2 * max(1, round(radius)) + 1
    return cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (size, size))
