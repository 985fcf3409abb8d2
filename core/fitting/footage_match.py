"""Whether a view's footage changes from key frame to key frame where the key poses move.

Footage of another camera or another take, and key poses of another world, are far from any solution: neither a small
correction of the camera nor the tracked motion says so. A camera that stands still sees a difference between two key
frames where the performers were or are, and little elsewhere; how well the one predicts the other is the probability
that a pixel there differs more than one elsewhere (the area under the receiver operating characteristic: T. Fawcett,
Pattern Recognition Letters 27 (2006) 861-874).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cache, partial
from itertools import combinations

import cv2
import numpy as np
from numpy.typing import NDArray

from ..body.kinematics import Poses, scene_poses
from ..cameras.camera import Camera
from ..errors import FootageError
from ..evidence.rendering.label_images import render_labels
from ..evidence.rendering.part_geometry import Geometry
from ..numerics.arrays import Array, Bools
from ..shot.footage import frames_at, probe
from ..shot.footage_faults.footage_checks import stored_frames
from ..shot.frame_numbers import footage_index
from ..shot.shot import Shot, View
from .background_shift import BackgroundShift, background_shift
from .key_frame_views import KeyFrameView
from .view_findings import FootageMatch

_SIDE = 160
"""Approximate longer side of the pictures that are compared, pixels."""
_MIN_PIXELS = 60
"""Fewest pixels on which performers must be on one key frame and not on another."""
_MIN_CHANGE = 4.0
"""Grey levels by which some pixel of two pictures must differ: others show the same, and say nothing."""
_MARGIN = np.ones((5, 5), np.uint8)
"""Pixels around the performers that count neither way: key poses are inexact."""
_MAX_SHIFT, _MIN_SHIFT = 30, 2
"""Greatest and least change of the offset that is tried, frames of the shot."""
_MAX_SHIFTED_KEYS, _MAX_READ = 5, 300
"""Greatest number of key frames that are used for that, and of frames from the first of them to the last."""
_MIN_SHIFTED_MATCH, _MIN_GAIN, _MIN_LACK = 0.97, 3.0, 0.01
"""Another offset is better if it matches at least this well, and if the present one lacks more of a match (1 - match):
this many times what the other lacks, and this much more."""
_CORE = np.ones((3, 3), np.uint8)
"""Pixels inside the performers' outlines that do not count as theirs, for the same reason as `_MARGIN`."""


def footage_matches(shot: Shot, views: Sequence[KeyFrameView], frames: NDArray[np.int64]) -> list[FootageMatch]:
    """Compare every view's pictures of K key frames with the key poses; cameras that move are left out, and views in
    which the poses differ too little.
    """
    poses = key_poses_of(shot, frames)
    geometry, found = Geometry.of([performer.body for performer in shot.performers]), []
    for view, pictured in zip(shot.views, views, strict=True):
        if view.camera.stands_still:
            own = _match(pictured.rectified(view.camera), pictured.camera(view.camera), geometry, poses)
            if own is not None:
                found.append(FootageMatch(view.camera.name, own))
    return found


def shifted_background(
    shot: Shot, view: View, pictured: KeyFrameView, frames: NDArray[np.int64]
) -> BackgroundShift | None:
    """Return how far the background of a camera that should stand still moves between K key frames, if it does."""
    if not view.camera.stands_still:
        return None
    camera, geometry = pictured.camera(view.camera), Geometry.of([performer.body for performer in shot.performers])
    body = render_labels(geometry, camera, 0, *key_poses_of(shot, frames)).part >= 0
    return background_shift(list(pictured.rectified(view.camera)), list(body), frames.tolist(), pictured.factor)


def better_offset(shot: Shot, view: View, frames: NDArray[np.int64]) -> float | None:
    """Return an offset with which a view's footage matches the key poses on K frames much better than with its own.

    Only the first part of long footage is read.
    """
    frames = frames[frames - frames[0] <= _MAX_READ][:_MAX_SHIFTED_KEYS]
    if len(frames) < 2 or not view.camera.stands_still:
        return None
    try:
        places = {int(f) + d for f in frames for d in range(-_MAX_SHIFT, _MAX_SHIFT + 1)}
        footage = probe(view.footage)
        count = stored_frames(view, footage, 0)
        shown = [f for f in sorted(places) if 0 <= footage_index(view, shot.frames[0] + f) < count]
        factor = max(1.0, max(view.camera.size) / _SIDE)
        read = frames_at(view, [shot.frames[0] + f for f in shown], factor, grey=False)
        pictures = dict(zip(shown, read, strict=True))
    except FootageError:
        return None
    return _best_offset(shot, view, frames, pictures, factor)


def _best_offset(
    shot: Shot, view: View, frames: NDArray[np.int64], pictures: Mapping[int, NDArray[np.uint8]], factor: float
) -> float | None:
    bodies, camera = [p.body for p in shot.performers], view.camera.reduced(factor).rectified()
    geometry, (R, T) = Geometry.of(bodies), key_poses_of(shot, frames)

    def lack(kept: tuple[int, ...], shift: int) -> float | None:
        shown = np.stack([pictures[int(frames[k]) + shift] for k in kept])
        match = _match(shown, camera, geometry, (R[list(kept)], T[list(kept)]))
        return None if match is None else 1 - match

    present = cache(partial(lack, shift=0))
    best, least = None, 1 - _MIN_SHIFTED_MATCH
    for shift in range(-_MAX_SHIFT, _MAX_SHIFT + 1):
        kept = tuple(k for k, f in enumerate(frames) if {int(f), int(f) + shift} <= pictures.keys())
        if abs(shift) < _MIN_SHIFT or len(kept) < max(2, len(frames) / 2):
            continue
        own, other = present(kept), lack(kept, shift)
        if own is not None and other is not None and other < least and own > _MIN_GAIN * other + _MIN_LACK:
            best, least = shift, other
    return None if best is None else view.offset + view.every * best


def key_poses_of(shot: Shot, frames: NDArray[np.int64]) -> Poses:
    """Return the world poses of all performers' parts on K frames on which all of them have key poses."""
    keys = [performer.key_poses for performer in shot.performers]
    return scene_poses(
        [performer.body for performer in shot.performers],
        [key.poses[np.searchsorted(key.frames, frames)] for key in keys],
    )


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
