"""Whether a view's footage changes from key frame to key frame where the key poses move.

How well it does is measured by `core.evidence.movement_match`; here views are compared as they are, and with other
offsets.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cache, partial

import numpy as np
from numpy.typing import NDArray

from ..body.kinematics import Poses
from ..errors import FootageError
from ..evidence.background_shift import BackgroundShift, background_shift, background_tells, background_zoom
from ..evidence.movement_match import COARSE_SIDE, key_poses_of, movement_match
from ..evidence.rendering.label_images import render_labels
from ..evidence.rendering.part_geometry import Geometry
from ..numerics.arrays import Bools
from ..shot.footage import frames_at, probe
from ..shot.footage_faults.footage_checks import stored_frames
from ..shot.frame_numbers import footage_index
from ..shot.shot import Shot, View
from .key_frame_views import KeyFrameView
from .view_findings import FootageMatch

_MAX_SHIFT, _MIN_SHIFT = 30, 2
"""Greatest and least change of the offset that is tried, frames of the shot."""
_MAX_SHIFTED_KEYS, _MAX_READ = 5, 300
"""Greatest number of key frames that are used for that, and of frames from the first of them to the last."""
_MIN_OTHER_MATCH, _MIN_GAIN, _MIN_LACK = 0.97, 3.0, 0.01
"""Footage with another offset, or mirrored, is better if it matches at least this well, and if it lacks, as it
is, more of a match (1 - match): this many times what the other lacks, and this much more."""
_MIN_MIRRORED_MATCH = 0.99
"""How well mirrored footage must match to be named: that of a camera opposite looks mirrored, too."""


def footage_matches(shot: Shot, views: Sequence[KeyFrameView], frames: NDArray[np.int64]) -> list[FootageMatch]:
    """Compare every view's pictures of K key frames with the key poses; cameras that move are left out, and views in
    which the poses differ too little.
    """
    poses = key_poses_of(shot, frames)
    geometry, found = Geometry.of([performer.body for performer in shot.performers]), []
    for view, pictured in zip(shot.views, views, strict=True):
        if view.camera.stands_still:
            pictures, camera = pictured.rectified(view.camera), pictured.camera(view.camera)
            own = movement_match(pictures, camera, geometry, poses)
            if own is None:
                continue
            other = None
            if 1 - own > _MIN_LACK:
                other = movement_match(np.ascontiguousarray(pictures[:, :, ::-1]), camera, geometry, poses)
            mirrored = other is not None and other > _MIN_MIRRORED_MATCH and _is_better(1 - other, 1 - own)
            found.append(FootageMatch(view.camera.name, own, mirrored=other if mirrored else None))
    return found


def _is_better(other: float, own: float) -> bool:
    """Whether footage that is shown in another way lacks so much less of a match that this is how it was taken."""
    return other < 1 - _MIN_OTHER_MATCH and own > _MIN_GAIN * other + _MIN_LACK


def shifted_background(
    view: View, pictured: KeyFrameView, geometry: Geometry, poses: Poses, frames: NDArray[np.int64]
) -> BackgroundShift | None:
    """Return how far the background of a camera that should stand still moves between K key frames, if it does.

    Parameters
    ----------
    view : View
    pictured : KeyFrameView
        Its pictures of these frames.
    geometry : Geometry
        Of all performers.
    poses
        World poses of their parts on these frames.
    frames : ndarray of int, shape (K,)
    """
    if not view.camera.stands_still:
        return None
    pictures, performers = _pictures_and_performers(view, pictured, geometry, poses)
    return background_shift(pictures, performers, frames.tolist(), pictured.factor)


def zoomed_background(
    view: View, pictured: KeyFrameView, geometry: Geometry, poses: Poses, frames: NDArray[np.int64]
) -> BackgroundShift | None:
    """Return where the size of the background differs most between K key frames, if it tells; parameters as of
    `shifted_background`.
    """
    pictures, performers = _pictures_and_performers(view, pictured, geometry, poses)
    return background_zoom(pictures, performers, frames.tolist(), pictured.factor)


def background_is_plain(view: View, pictured: KeyFrameView, geometry: Geometry, poses: Poses) -> bool:
    """Whether the background of a camera that should stand still does not show if it does; parameters as of
    `shifted_background`.
    """
    return view.camera.stands_still and not background_tells(*_pictures_and_performers(view, pictured, geometry, poses))


def _pictures_and_performers(
    view: View, pictured: KeyFrameView, geometry: Geometry, poses: Poses
) -> tuple[list[NDArray[np.uint8]], list[Bools]]:
    """Return the rectified pictures of a view's key frames, and where the performers are in them."""
    body = render_labels(geometry, pictured.camera(view.camera), 0, *poses).part >= 0
    return list(pictured.rectified(view.camera)), list(body)


def better_shift(shot: Shot, view: View, frames: NDArray[np.int64]) -> int | None:
    """Return by how many frames of the shot later footage of a view matches the key poses on K frames much better.

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
        factor = max(1.0, max(view.camera.size) / COARSE_SIDE)
        read = frames_at(view, [shot.frames[0] + f for f in shown], factor, grey=False)
        pictures = dict(zip(shown, read, strict=True))
    except FootageError:
        return None
    return _best_shift(shot, view, frames, pictures, factor)


def _best_shift(
    shot: Shot, view: View, frames: NDArray[np.int64], pictures: Mapping[int, NDArray[np.uint8]], factor: float
) -> int | None:
    bodies, camera = [p.body for p in shot.performers], view.camera.reduced(factor).rectified()
    geometry, (R, T) = Geometry.of(bodies), key_poses_of(shot, frames)

    def lack(kept: tuple[int, ...], shift: int) -> float | None:
        shown = np.stack([pictures[int(frames[k]) + shift] for k in kept])
        match = movement_match(shown, camera, geometry, (R[list(kept)], T[list(kept)]))
        return None if match is None else 1 - match

    present = cache(partial(lack, shift=0))
    best, least = None, 1.0
    for shift in range(-_MAX_SHIFT, _MAX_SHIFT + 1):
        kept = tuple(k for k, f in enumerate(frames) if {int(f), int(f) + shift} <= pictures.keys())
        if abs(shift) < _MIN_SHIFT or len(kept) < max(2, len(frames) / 2):
            continue
        own, other = present(kept), lack(kept, shift)
        if own is not None and other is not None and other < least and _is_better(other, own):
            best, least = shift, other
    return best
