"""Masks of pictures, made smaller and larger."""

from __future__ import annotations

import cv2
import numpy as np

from ..numerics.arrays import Bools

RIM = 2
"""Pixels at a mask's edge that show something of both sides."""


def within(mask: Bools, rim: int = RIM) -> Bools:
    """A mask less its rim of so many pixels."""
    return np.asarray(cv2.erode(mask.astype(np.uint8), _disc(rim)) > 0)


def beyond(mask: Bools, margin: float) -> Bools:
    """What is farther from a mask than a margin, pixels."""
    return np.asarray(cv2.dilate(mask.astype(np.uint8), _disc(margin)) == 0)


def near(mask: Bools, distance: float) -> Bools:
    """What is no farther from a mask than a distance, pixels, which may be large."""
    return np.asarray(cv2.distanceTransform((~mask).astype(np.uint8), cv2.DIST_L2, 3) <= distance)


def without_specks(mask: Bools, radius: float) -> Bools:
    """A mask without what is smaller than a disc of a radius, pixels."""
    return np.asarray(cv2.morphologyEx(mask.astype(np.uint8), cv2.MORPH_OPEN, _disc(radius)) > 0)


def _disc(radius: float) -> cv2.typing.MatLike:
    size = 2 * max(1, round(radius)) + 1
    return cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (size, size))
