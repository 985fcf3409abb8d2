"""Small spots that are more of a colour than what lies around them, ranked.

A range of colours separates a small ball from the room only if nothing in the room has such colours: with brown boards
in warm light, half the floor is in the range of red. But a ball is a spot that is redder than the boards on every side
of it, whereas the edge of a book is redder than its surroundings on two sides only. So spots are ranked by how much
their colour exceeds that of the surroundings in the direction in which it does so least, and the best are measured as
small balls.
"""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from ...capture.linear_light import LINEAR_LIGHT
from ...numerics.arrays import Array
from ...numerics.robust_kernels import NORMAL_MAD
from .found_balls import Balls, FoundBall
from .small_balls import measure_small_ball

Image = NDArray[Any]

_FILTER_SIGMA = 1.25  # of the filter, pixels: with the picture's own smoothing, about that of a ball of four pixels
_MIN_LIGHT = 0.03  # sum of a pixel's light beside which its colour is too uncertain
_PEAK_WINDOW = np.ones((5, 5), np.uint8)  # where a spot's height is the greatest
_MIN_SIGMAS = 6.0  # deviations of the room by which a spot must stand out
_MIDDLE_WINDOW = np.ones((3, 3), np.uint8)  # of a spot's middle, where the picture must have the colour
_MIN_SPACING = 2.0  # pixels within which two spots are one


def coloured_spots(image: Image, light: Array, coloured: Image, pure: Array, *, most: int) -> Balls:
    """Return the small balls among the spots of a colour, the most conspicuous first.

    Parameters
    ----------
    image : ndarray of uint8, shape (h, w, 3)
        See `Picture.even`.
    light : ndarray, shape (256,)
        Linear light of its levels.
    coloured : ndarray of uint8, shape (h, w)
        Where the picture may have the colour.
    pure : ndarray, shape (3,)
        The colour's blue, green and red, as pure as can be.
    most : int
        How many of them at most.
    """
    found: list[FoundBall] = []
    near = cv2.dilate(coloured, _MIDDLE_WINDOW) > 0
    for v, u in _peaks(_standing_out(_share_of(image, pure)), near):
        if len(found) == most:
            break
        ball = measure_small_ball(image, light, np.array([u, v], float))
        if ball is not None and all(np.linalg.norm(ball.centre - other.centre) > _MIN_SPACING for other in found):
            found.append(ball)
    return Balls.of(found)


def _share_of(image: Image, pure: Array) -> Image:
    """Return how much of the light of every pixel is of a colour and not grey: 1 where it is pure, shape (h, w)."""
    linear = LINEAR_LIGHT.astype(np.float32)[image]
    way = pure / pure.sum() - 1 / 3
    return np.asarray(linear @ (way / (way @ way)).astype(np.float32) / (linear.sum(axis=2) + np.float32(_MIN_LIGHT)))


def _standing_out(share: Image) -> Image:
    """Return the curvature downwards in the direction in which it is least: the lesser eigenvalue of the Hessian."""
    smooth = cv2.GaussianBlur(share, (0, 0), _FILTER_SIGMA)
    along, down, across = (cv2.Sobel(smooth, -1, *order, ksize=3) / 4 for order in ((2, 0), (0, 2), (1, 1)))
    return np.asarray(-(_FILTER_SIGMA**2) * ((along + down) / 2 + np.hypot((along - down) / 2, across)))


def _peaks(height: Image, coloured: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Return the pixels (v, u) of the spots, the highest first."""
    room = NORMAL_MAD * float(np.median(np.abs(height - np.median(height))))
    places = np.argwhere((height >= cv2.dilate(height, _PEAK_WINDOW)) & coloured & (height > _MIN_SIGMAS * room))
    return places[np.argsort(-height[tuple(places.T)], kind="stable")]
