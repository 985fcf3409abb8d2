"""Whether a view's footage changes from key frame to key frame where the key poses move.

Footage of another camera or another take, and key poses of another world, are far from any solution: neither a small
correction of the camera nor the tracked motion says so. A camera that stands still sees a difference between two key
frames where the performers were or are, and little elsewhere; how well the one predicts the other is the probability
that a pixel there differs more than one elsewhere (the area under the receiver operating characteristic: T. Fawcett,
Pattern Recognition Letters 27 (2006) 861-874).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from ..body.kinematics import Poses, scene_poses
from ..cameras.camera import Camera
from ..evidence.rendering.label_images import render_labels
from ..evidence.rendering.part_geometry import Geometry
from ..numerics.arrays import Array, Bools
from ..shot.shot import Shot
from .key_frame_views import KeyFrameView

MIN_MATCH = 0.9
"""Probability from which footage is the key poses': see docs/refinement.md for those of right and of wrong footage."""
_SIDE = 160
"""Approximate longer side of the pictures that are compared, pixels."""
_MIN_PIXELS = 60
"""Fewest pixels on which performers must be on one key frame and not on another."""
_MIN_CHANGE = 4.0
"""Largest difference between two pictures, grey levels, of pictures that show nobody and say nothing."""
_MARGIN = np.ones((5, 5), np.uint8)
"""Pixels around the performers that count neither way: key poses are inexact."""
_CORE = np.ones((3, 3), np.uint8)


@dataclass(frozen=True)
class FootageMatch:
    """How well a view's footage matches the key poses.

    Attributes
    ----------
    camera : str
    match : float
        Probability that a pixel of the performers differs more between two key frames than one beside them.
    by : str
    """

    camera: str
    match: float
    by: Literal["movement"] = "movement"

    @property
    def off(self) -> bool:
        """Whether this is hardly the footage in which the poses were set."""
        return self.match < MIN_MATCH

    @property
    def brief(self) -> str:
        """A few words, for the user."""
        return "footage and key poses do not belong together"

    @property
    def summary(self) -> str:
        """One line on what is wrong and what to look for, for the user."""
        return (
            f"{self.camera}: its pictures do not change where the key poses move ({self.match:.2f}; 1 where they do, "
            f"0.5 by chance): see whether this is the footage of {self.camera}, whether its offset is right, and "
            "whether the key poses and the calibration belong to this shot"
        )


def footage_matches(shot: Shot, views: Sequence[KeyFrameView], frames: NDArray[np.int64]) -> list[FootageMatch]:
    """Compare every view's pictures of K key frames with the key poses; cameras that move are left out, and views in
    which the poses differ too little.
    """
    bodies = [performer.body for performer in shot.performers]
    keys = [performer.key_poses for performer in shot.performers]
    poses = scene_poses(bodies, [key.poses[np.searchsorted(key.frames, frames)] for key in keys])
    geometry, found = Geometry.of(bodies), []
    for view, pictured in zip(shot.views, views, strict=True):
        if view.camera.stands_still:
            own = _match(pictured.rectified(view.camera), pictured.camera(view.camera), geometry, poses)
            if own is not None:
                found.append(FootageMatch(view.camera.name, own))
    return found


def _match(pictures: NDArray[np.uint8], camera: Camera, geometry: Geometry, poses: Poses) -> float | None:
    """Return the mean over pairs of key frames, weighted by the number of pixels that say it; None if these are few."""
    small = camera.reduced(max(1.0, max(camera.size) / _SIDE))
    shown = [_blurred(picture, small.size) for picture in pictures]
    body = [part.astype(np.uint8) for part in render_labels(geometry, small, 0, *poses).part >= 0]
    inner, outer = [cv2.erode(mask, _CORE) > 0 for mask in body], [cv2.dilate(mask, _MARGIN) > 0 for mask in body]
    counts, chances = [], []
    for a, b in combinations(range(len(shown)), 2):
        moved, still = (inner[a] & ~outer[b]) | (inner[b] & ~outer[a]), ~(outer[a] | outer[b])
        if moved.any() and still.any():
            different = _difference(shown[a], shown[b], still)
            if different.max() < _MIN_CHANGE:
                continue
            counts.append(int(moved.sum()))
            chances.append(_chance_of_more(different[moved], different[still]))
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
