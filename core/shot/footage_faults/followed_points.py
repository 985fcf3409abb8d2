"""Following what moves through six consecutive pictures.

Where a frame is missing between two pictures, everything that moves goes once as far as in two frames. Points of what
moves are followed by optical flow, and the way of each across the pair in question is compared with the longest that
its ways before and after let expect. A limb that starts to move, or hits something, does not double the speed of all
the others. Points that flow forward and backward does not lead back to where they were are left out: where most are,
there is no result.

(Flow: T. Kroeger et al., Fast Optical Flow using Dense Inverse Search, ECCV 2016.)
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from ...numerics.arrays import Array

PICTURE_SIDE = 256
"""Length of the longer side of the pictures in which points are followed, pixels."""
FOLLOWED_PICTURES = 2
"""Number of pictures before a pair, and after it, through which points are followed."""
_POINT_SPACING = 4
"""Distance of the points, pixels."""
_MIN_WAY, _MIN_WAY_SHARE = 1.5, 0.3
"""Ways through three pairs that count: pixels, and in terms of the longest twentieth."""
_MAX_RETURN_ERROR, _MAX_RELATIVE_RETURN_ERROR = 0.5, 0.15
"""How near flow must lead a point back to its place: pixels, or relative to its way."""
_MIN_SPEED_RATIO = 1.15
"""How much faster than before and after it motion must be across a pair for all ways to be followed."""
_MIN_POINTS = 12
"""Smallest number of points from which a ratio is estimated."""


@dataclass(frozen=True, eq=False)
class PointTracks:
    """Ways of points across a pair of pictures, and across those before and after it.

    Attributes
    ----------
    length : ndarray, shape (N,)
        Length of the way through the pair and its two neighbours, pixels.
    along : ndarray, shape (5, N)
        Ways along that direction across five consecutive pairs, pixels; the third is the one in question.
    """

    length: Array
    along: Array

    @property
    def excess(self) -> float:
        """Ratio of the points' ways across the pair to those expected, its median over the motion; 0 if too few
        points could be followed.
        """
        if len(self.length) < _MIN_POINTS:
            return 0.0
        first, before, here, after, last = self.along
        even = (4 * (before + after) - first - last) / 6
        expected = np.max([before, after, 2 * before - first, 2 * after - last, even], axis=0)
        ratio = here / np.maximum(expected, 0.05 * self.length)
        order = np.argsort(ratio, kind="stable")
        share = np.cumsum(self.length[order])
        return float(ratio[order][np.searchsorted(share, share[-1] / 2)])


def reduced(picture: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Reduce a picture, grey (H, W) or in colour (H, W, 3), to the grey one (h, w) in which points are followed."""
    height, width = picture.shape[:2]
    grey = cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY) if picture.ndim == 3 else picture
    scale = PICTURE_SIDE / max(height, width)
    size = max(round(width * scale), 16), max(round(height * scale), 16)
    return np.asarray(cv2.resize(grey, size, interpolation=cv2.INTER_AREA), np.uint8)


def follow_points(pictures: Sequence[NDArray[np.uint8]]) -> PointTracks:
    """Follow what moves through six consecutive pictures, results of `reduced`; the pair is the two in the middle.

    No way is returned where motion is hardly faster across the pair than before or after it.
    """
    flow = cv2.DISOpticalFlow.create(cv2.DISOPTICAL_FLOW_PRESET_MEDIUM)

    def field(a: int, b: int) -> Array:
        return np.asarray(flow.calc(pictures[a], pictures[b], None))

    height, width = pictures[0].shape
    v, u = np.mgrid[_POINT_SPACING // 2 : height : _POINT_SPACING, _POINT_SPACING // 2 : width : _POINT_SPACING]
    places = np.stack([u, v], axis=-1).astype(np.float32)
    there, steps = _moved(places, field(2, 3))
    earlier, returns = _moved(places, field(2, 1))
    later, ahead = _moved(there, field(3, 4))
    total = steps - returns + ahead
    length = np.linalg.norm(total, axis=-1)
    moving = length > max(_MIN_WAY, _MIN_WAY_SHARE * float(np.quantile(length, 0.95)))
    here, before, after = (np.linalg.norm(way, axis=-1)[moving] for way in (steps, returns, ahead))
    if not len(here) or float(np.quantile(here / np.maximum(before + after, 1e-6), 0.75)) < _MIN_SPEED_RATIO / 2:
        return PointTracks(np.zeros(0), np.zeros((5, 0)))
    for origin, end, way, pair in (
        (places, there, steps, (3, 2)),
        (places, earlier, returns, (1, 2)),
        (there, later, ahead, (4, 3)),
    ):
        missed = np.linalg.norm(_moved(end, field(*pair))[0] - origin, axis=-1)
        moving &= missed < np.maximum(_MAX_RETURN_ERROR, _MAX_RELATIVE_RETURN_ERROR * np.linalg.norm(way, axis=-1))
    ways = -_moved(earlier, field(1, 0))[1], -returns, steps, ahead, _moved(later, field(4, 5))[1]
    direction = total / np.maximum(length, 1e-6)[..., None]
    along = np.array([(way * direction).sum(axis=-1)[moving] for way in ways])
    return PointTracks(length[moving], along)


def _moved(places: Array, field: Array) -> tuple[Array, Array]:
    """Return where a flow field leads positions (..., 2), and the ways there."""
    way = cv2.remap(
        field,
        places[..., 0].astype(np.float32),
        places[..., 1].astype(np.float32),
        cv2.INTER_LINEAR,
        borderMode=cv2.BORDER_REPLICATE,
    )
    return places + way, np.asarray(way)
