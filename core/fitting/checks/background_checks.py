"""Checks of cameras by the background of key frames: whether one that should stand still moved or zooms.

Each looks at a `PosedView`, which computes once what several of them need, and returns a finding.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from ...cameras.lens_turns import split
from ...evidence.background_shift import BackgroundShift, largest_shift
from ...numerics.arrays import Array
from ...shot.shot import Shot
from .posed_views import PosedView
from .view_findings import CameraFit, MovedCamera, PlainBackground, ViewFinding


def moved_camera(posed: PosedView) -> MovedCamera | None:
    """Return how far a camera moved between key frames, or was held in the hand, though its calibration has one pose;
    None if it stood still, or its background does not tell.
    """
    shift = largest_shift(posed.background, posed.factor) if posed.stands_still else None
    return None if shift is None else MovedCamera(posed.name, shift)


def followed_cameras(shot: Shot, turns: Sequence[Array | None]) -> tuple[MovedCamera, ...]:
    """Return the cameras of a shot whose turns and zooms were measured; frames are counted as in the shot file."""
    found = []
    for view, own in zip(shot.views, turns, strict=False):
        if own is not None:
            rotations, zooms = split(own)
            ways = view.camera.displacements(rotations)
            shift = BackgroundShift(float(ways.max()), _ends(ways, shot.frames[0]))
            frames = _ends(zooms, shot.frames[0])
            zoom = BackgroundShift(0.0, frames, float(zooms.max() / zooms.min())) if (zooms != 1).any() else None
            found.append(MovedCamera(view.camera.name, shift, followed=True, zoom=zoom))
    return tuple(found)


def _ends(values: Array, first: int) -> tuple[int, int]:
    """Return the frames with the least and the greatest of some values, counted from a first frame."""
    return first + int(np.argmin(values)), first + int(np.argmax(values))


def with_plain_backgrounds(
    findings: Sequence[ViewFinding], views: Sequence[PosedView], followed: Sequence[MovedCamera]
) -> tuple[ViewFinding, ...]:
    """Return findings, and of which cameras the background does not show whether they moved: a fit of a camera that is
    off says so itself; others are named only if some of the shot were found to turn.
    """
    off = _names(own for own in findings if isinstance(own, CameraFit) and own.off)
    doubted = [posed for posed in views if followed or posed.name in off]
    plain = [posed.name for posed in doubted if background_is_plain(posed)]
    marked = [
        replace(own, plain=True) if isinstance(own, CameraFit) and own.off and own.camera in plain else own
        for own in findings
    ]
    return (*(PlainBackground(name) for name in plain if name not in off), *marked)


def background_is_plain(posed: PosedView) -> bool:
    """Whether the background of a camera that should stand still does not show if it does."""
    return posed.stands_still and len(posed.frames) > 1 and not any(posed.background)


def _names(findings: Iterable[ViewFinding]) -> set[str]:
    return {own.camera for own in findings}
