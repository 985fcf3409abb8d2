"""How well the pictures of a camera that stands still change where key poses move.

Footage of another camera or another take, and key poses of another world, are far from any solution: neither a small
correction of the camera nor the tracked motion says so. A camera that stands still sees a difference between two key
frames where the performers were or are, and little elsewhere; how well the one predicts the other is the probability
that a pixel there differs more than one elsewhere (the area under the receiver operating characteristic: T. Fawcett,
Pattern Recognition Letters 27 (2006) 861-874).
"""

from __future__ import annotations

from functools import cache
from itertools import combinations

import cv2
import numpy as np
from numpy.typing import NDArray

from ..body.kinematics import Poses, scene_poses
from ..cameras.camera import Camera
from ..numerics.arrays import Array, Bools
from ..shot.shot import Shot
from .rendering.label_images import render_labels
from .rendering.part_geometry import Geometry

MIN_MATCH = 0.9
"""Probability from which footage is the key poses': see docs/refinement.md for those of right and of wrong footage."""
COARSE_SIDE, FINE_SIDE = 160, 320
"""Approximate longer side of the pictures that are compared, pixels; the finer ones if too little moves in the others:
where performers are small, or their key poses much alike."""
_MIN_PIXELS = 60
"""Fewest pixels on which performers must be on one key frame and not on another."""
_MIN_CHANGE = 4.0
"""Grey levels by which some pixel of two pictures must differ: others show the same, and say nothing."""
_MARGIN, _CORE = np.ones((5, 5), np.uint8), np.ones((3, 3), np.uint8)
"""Pixels around the performers, and inside their outlines, that count neither way: key poses are inexact."""


def key_poses_of(shot: Shot, frames: NDArray[np.int64]) -> Poses:
    """Return the world poses of all performers' parts on K frames on which all of them have key poses."""
    keys = [performer.key_poses for performer in shot.performers]
    return scene_poses(
        [performer.body for performer in shot.performers],
        [key.poses[np.searchsorted(key.frames, frames)] for key in keys],
    )


def movement_match(
    pictures: NDArray[np.uint8], camera: Camera, geometry: Geometry, poses: Poses, *, least: float = 0.0
) -> float | None:
    """Return the probability that a pixel of the performers differs more between two key frames than one beside them:
    its mean over pairs of K frames, weighted by the number of pixels that say it; None if these are few.

    Parameters
    ----------
    pictures : ndarray of uint8, shape (K, h, w, 3)
        Without lens distortion.
    camera : Camera
        That of the pictures, whose frame k is the k-th of them.
    geometry : Geometry
        Of all performers.
    poses
        World poses of their parts on these frames.
    least : float
        If the first pairs show that the probability is less than this, an upper limit of it is returned.
    """
    for side in (COARSE_SIDE, FINE_SIDE):
        found = _match(pictures, camera.reduced(max(1.0, max(camera.size) / side)), geometry, poses, least)
        if found is not None:
            return found
    return None


def _match(pictures: NDArray[np.uint8], small: Camera, geometry: Geometry, poses: Poses, least: float) -> float | None:
    shown = cache(lambda k: _blurred(pictures[k], small.size))
    body = [part.astype(np.uint8) for part in render_labels(geometry, small, 0, *poses).part >= 0]
    inner, outer = [cv2.erode(mask, _CORE) > 0 for mask in body], [cv2.dilate(mask, _MARGIN) > 0 for mask in body]
    pairs = []
    for a, b in combinations(range(len(pictures)), 2):
        moved, still = (inner[a] & ~outer[b]) | (inner[b] & ~outer[a]), ~(outer[a] | outer[b])
        if moved.any() and still.any():
            pairs.append((a, b, moved, still))
    counts, chances, ahead = list[int](), list[float](), sum(int(moved.sum()) for _, _, moved, _ in pairs)
    for a, b, moved, still in pairs:
        count = int(moved.sum())
        ahead -= count
        different = _difference(shown(a), shown(b), still)
        if different.max() < _MIN_CHANGE:
            continue
        counts.append(count)
        chances.append(_chance_of_more(different[moved], different[still]))
        at_most = float(np.average([*chances, 1.0], weights=[*counts, ahead]))
        if at_most < least and sum(counts) >= _MIN_PIXELS:
            return at_most
    return float(np.average(chances, weights=counts)) if sum(counts) >= _MIN_PIXELS else None


def _blurred(picture: NDArray[np.uint8], size: tuple[int, int]) -> Array:
    reduced = cv2.resize(picture, size, interpolation=cv2.INTER_AREA).astype(np.float32)
    return np.asarray(cv2.GaussianBlur(reduced, (0, 0), 1.0))


def _difference(a: Array, b: Array, still: Bools) -> Array:
    """Return the largest difference of two pictures' channels, (h, w), but for the exposure and the colour of the light
    in what stands still.
    """
    gain = np.median((a[still] + 1) / (b[still] + 1), axis=0)
    return np.asarray(np.abs(a - gain * b).max(axis=-1))


def _chance_of_more(some: Array, others: Array) -> float:
    """Return the probability that one of some numbers is larger than one of others (Mann and Whitney)."""
    ordered = np.sort(others)
    ranks = np.searchsorted(ordered, some, "left") + np.searchsorted(ordered, some, "right")
    return float(ranks.mean() / (2 * len(others)))
