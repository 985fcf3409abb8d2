"""What explains that views do not show the key poses: a camera that is off or was moved, or another offset."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ..evidence.background_shift import BackgroundShift
from ..evidence.movement_match import key_poses_of
from ..evidence.rendering.part_geometry import Geometry
from ..numerics.arrays import Array
from ..shot.shot import Shot
from .footage_match import background_is_plain, better_shift, shifted_background, zoomed_background
from .key_frame_views import KeyFrameView
from .view_findings import CameraFit, FootageMatch, MovedCamera, PlainBackground, ViewFinding

MAX_SHIFT_SPREAD = 4.0
"""Largest difference between shifts of all views that mean one thing, key poses that lag, frames of the shot: each is
known to two frames at most."""

_MIN_LACK = 0.005
"""How much footage must lack of a match with the key poses for other offsets to be tried (1 - match): more than all of
75 views with the right offset but four, in which things that move or stand in front explain it."""


def moved_cameras(
    shot: Shot,
    views: Sequence[KeyFrameView],
    frames: NDArray[np.int64],
) -> dict[str, MovedCamera]:
    """Return the cameras that were moved during the shot, or held in the hand, though their calibration has one pose.

    Parameters
    ----------
    shot : Shot
    views : sequence of KeyFrameView
        The pictures of its views on those frames.
    frames : ndarray of int, shape (K,)
        Shot frames with key poses of the whole body.

    Returns
    -------
    dict of str to MovedCamera
        By the cameras' names; their frames are counted as in the shot file.
    """
    found, poses = {}, key_poses_of(shot, frames)
    geometry = Geometry.of([performer.body for performer in shot.performers])
    for view, pictured in zip(shot.views, views, strict=True):
        shift = shifted_background(view, pictured, geometry, poses, frames)
        if shift is not None:
            first, name = shot.frames[0], view.camera.name
            there = replace(shift, frames=(first + shift.frames[0], first + shift.frames[1]))
            found[name] = MovedCamera(name, there)
    return found


def with_plain_backgrounds(
    shot: Shot,
    views: Sequence[KeyFrameView],
    frames: NDArray[np.int64],
    findings: Sequence[ViewFinding],
    *,
    turning: bool,
) -> tuple[ViewFinding, ...]:
    """Return findings, and of which cameras the background does not show whether they moved: a fit of a camera that is
    off says so itself; others are named only if others of the shot moved. Other parameters as of `moved_cameras`.

    Parameters
    ----------
    findings : sequence of ViewFinding
    turning : bool
        Whether others were found to turn.
    """
    off = {own.camera for own in findings if isinstance(own, CameraFit) and own.off}
    if len(frames) < 2 or not (turning or off):
        return (*findings,)
    poses, geometry = key_poses_of(shot, frames), Geometry.of([performer.body for performer in shot.performers])
    plain = [
        view.camera.name
        for view, pictured in zip(shot.views, views, strict=True)
        if (turning or view.camera.name in off) and background_is_plain(view, pictured, geometry, poses)
    ]
    said = [
        replace(own, plain=True) if isinstance(own, CameraFit) and own.off and own.camera in plain else own
        for own in findings
    ]
    return (*(PlainBackground(name) for name in plain if name not in off), *said)


def followed_cameras(shot: Shot, turns: Sequence[Array | None]) -> tuple[MovedCamera, ...]:
    """Return the cameras of a shot whose turns were measured; frames are counted as in the shot file."""
    found = []
    for view, own in zip(shot.views, turns, strict=False):
        if own is not None:
            ways, first = view.camera.displacements(own), shot.frames[0]
            frames = first + int(np.argmin(ways)), first + int(np.argmax(ways))
            found.append(MovedCamera(view.camera.name, BackgroundShift(float(ways.max()), frames), followed=True))
    return tuple(found)


def with_zooms(
    shot: Shot, views: Sequence[KeyFrameView], frames: NDArray[np.int64], followed: Sequence[MovedCamera]
) -> tuple[MovedCamera, ...]:
    """Return the cameras whose turns were measured, and of which of them the lens zooms, which is not allowed for;
    other parameters as of `moved_cameras`.

    Parameters
    ----------
    followed : sequence of MovedCamera
    """
    if len(frames) < 2:
        return (*followed,)
    poses, geometry = key_poses_of(shot, frames), Geometry.of([performer.body for performer in shot.performers])
    found, first = {own.camera: own for own in followed}, shot.frames[0]
    for view, pictured in zip(shot.views, views, strict=True):
        name = view.camera.name
        zoom = zoomed_background(view, pictured, geometry, poses, frames) if name in found else None
        if zoom is not None:
            there = replace(zoom, frames=(first + zoom.frames[0], first + zoom.frames[1]))
            found[name] = replace(found[name], zoom=there)
    return (*found.values(),)


def attributed_findings(
    shot: Shot, frames: NDArray[np.int64], matches: Sequence[FootageMatch], fits: Sequence[CameraFit]
) -> tuple[ViewFinding, ...]:
    """Return the cameras' fits, and what else explains that views do not show the key poses.

    A camera that can be corrected explains that its footage does not match. Another offset explains both; but where
    performers walk steadily, a camera that was turned looks like one that is late.

    Parameters
    ----------
    shot : Shot
    frames : ndarray of int, shape (K,)
        Shot frames with key poses of the whole body.
    matches, fits : sequence of FootageMatch, of CameraFit
        How well the views' footage and cameras fit the key poses.
    """
    correctable = {fit.camera for fit in fits if fit.off}
    mirrored = {match.camera: match for match in matches if match.mirrored is not None}
    unlike = {match.camera: match for match in matches if match.off and match.camera not in correctable} | mirrored
    views = {view.camera.name: view for view in shot.views}
    shifts: dict[str, int] = {}
    for match in matches:
        view = views[match.camera]
        doubtful = match.camera in correctable or match.camera in unlike or 1 - match.match > _MIN_LACK
        if match.mirrored is None and doubtful:
            shift = better_shift(shot, view, frames)
            if shift is not None:
                shifts[match.camera] = shift
                unlike[match.camera] = replace(match, offset=view.offset + view.every * shift)
    if len(matches) > 1 and len(unlike) == len(matches) and common_shift(list(shifts.values()), len(matches)) is None:
        # The key poses are elsewhere, or of another movement: some offset always fits a little better.
        unlike = {name: without for name, own in unlike.items() if (without := replace(own, offset=None)).off}
    rest = [fit for fit in fits if fit.camera not in (mirrored if fit.off else unlike)]
    return (*unlike.values(), *rest)


def common_shift(shifts: Sequence[float], views: int) -> float | None:
    """Return the shift, in frames of the shot, by which the footage of all of a number of views matches better.

    None if it is not known of all of them, or if they differ by more than `MAX_SHIFT_SPREAD`. Where they agree, the key
    poses are rather late or early than all the views.
    """
    if not shifts or len(shifts) < views or max(shifts) - min(shifts) > MAX_SHIFT_SPREAD:
        return None
    return float(np.median(shifts))
