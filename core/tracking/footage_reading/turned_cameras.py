"""Cameras that are held in the hand, or whose tripod was kicked, or whose lens zooms, though their calibration has one
pose and one focal length.

How they turn and zoom is measured in their pictures (`core.evidence.background_turn`), and they get a pose, and a zoom,
for every frame. All that is seen through a camera then uses that pose, and the pictures are read as if it had stood
still (module `reader`). The calibrated pose and focal length are taken to be those on the first frame with a key
pose, or on the first of all if key poses are only proposed; or, where key poses were set by eye as if the camera had
stood still, those on every such frame.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import replace

import numpy as np

from ...body.kinematics import scene_poses
from ...body.motion import Motion
from ...cameras.camera import Camera
from ...cameras.lens_turns import interpolated, since, split
from ...errors import FootageError
from ...evidence.background_shift import MIN_SHIFT, background_shift
from ...evidence.background_turn import background_turns
from ...evidence.movement_match import key_poses_of, movement_match
from ...evidence.rendering.label_images import render_labels
from ...evidence.rendering.part_geometry import Geometry
from ...numerics.arrays import Array, Bools, evenly_spaced
from ...shot.footage import frames_at, working_factor
from ...shot.keypose_spline import spline
from ...shot.segments import Segment, posed_frames, whole_keys
from ...shot.shot import Shot, View
from .reader import ColourFrames, Image

_LOOK_EVERY = 40
"""Distance in frames at which backgrounds are compared at least; else only on frames with key poses, as it takes as
long as decoding some frames."""
_MIN_MEASURED = 0.8
"""Share of the frames on which the background must show how a camera turned; the turn is interpolated on the others."""
_MAX_COMPARED_KEYS = 5
"""Greatest number of key frames that show whether key poses were set by eye."""
_MIN_SHIFTED = 3
"""On how many frames the background must lie elsewhere for its camera to turn."""
_EARLY_FRAMES = range(0, 31, 10)
"""Frames on which backgrounds are compared before anything is tracked: what is held in the hand has moved by then."""

Turns = tuple[Array | None, ...]
"""Per view: turns (F, 3, 3) from its calibrated axes to those on every frame, which may zoom
(`core.cameras.lens_turns`); None if it is as calibrated."""


class BackgroundWatch:
    """Looks, while footage is read, whether the background of a view's pictures stands still.

    Parameters
    ----------
    shot : Shot
    start : sequence of Motion
        The performers' motions before tracking: where they are, roughly.
    """

    def __init__(self, shot: Shot, start: Sequence[Motion]) -> None:
        self._bodies = [performer.body for performer in shot.performers]
        self._geometry, self._start = Geometry.of(self._bodies), start
        self._posed = set(posed_frames(shot, 0, shot.length - 1).frames.tolist())
        self._first: tuple[int, Image, Bools] | None = None

    def shifts(self, frames: ColourFrames, segment: Segment) -> bool:
        """Whether it lies elsewhere on some of a segment's frames than on the first with a key pose."""
        first, last = segment
        between = range(first + _LOOK_EVERY, last, _LOOK_EVERY)
        chosen = [f for f in range(first, last + 1) if f in self._posed or f in between]
        if self._first is not None and first in self._posed:
            chosen.remove(first)  # it was the last frame of the segment before
        if not chosen:
            return False
        bodies = scene_poses(self._bodies, [motion[chosen] for motion in self._start])
        masks = render_labels(self._geometry, frames.camera, 0, *bodies).part >= 0
        looked = [(f, frames.colour[f - frames.first], mask) for f, mask in zip(chosen, masks, strict=True)]
        if self._first is None:
            number, picture, mask = next((one for one in looked if one[0] in self._posed), looked[0])
            self._first = number, picture.copy(), mask
        every = [self._first, *(one for one in looked if one[0] != self._first[0])]
        numbers, pictures, masked = zip(*every, strict=True)
        return background_shift(pictures, masked, numbers, 1.0) is not None


def with_early_turns(shot: Shot, frames: Collection[int] = (), calibrated: int | None = None) -> Shot:
    """Return a shot in which the cameras that turn have a pose for every frame, before anything is tracked.

    Backgrounds are compared on the first frames, and on some more. Unless the shot's settings say otherwise.

    Parameters
    ----------
    shot : Shot
        Performers without key poses may be anywhere in the pictures.
    frames : collection of int, optional
        More shot frames on which backgrounds are compared.
    calibrated : int, optional
        See `with_measured_turns`.

    Raises
    ------
    FootageError
        The footage ends or breaks early.
    """
    if shot.settings.stabilise is False:
        return shot
    looked = sorted(f for f in {*_EARLY_FRAMES, *frames} if f < shot.length)
    views = range(len(shot.views))
    found = views if shot.settings.stabilise else [v for v in views if _shifts(shot, shot.views[v], looked)]
    return with_measured_turns(shot, found, calibrated)


def calibrated_frame(shot: Shot) -> int:
    """Return the shot frame on which cameras are taken to be as calibrated."""
    return min((int(f) for performer in shot.performers for f in performer.key_poses.full()), default=0)


def with_measured_turns(shot: Shot, views: Collection[int], calibrated: int | None = None) -> Shot:
    """Return a shot in which those of some views whose pictures show how their camera turns have a pose for every
    frame.

    Parameters
    ----------
    shot : Shot
    views : collection of int
    calibrated : int, optional
        The shot frame on which cameras are as calibrated; `calibrated_frame` by default.

    Raises
    ------
    FootageError
        The footage ends or breaks early.
    """
    if calibrated is None:
        calibrated = calibrated_frame(shot)
    turns = [_measured(shot, view, calibrated) if v in views else None for v, view in enumerate(shot.views)]
    if _set_by_eye(shot, turns):
        turns = [None if own is None else since(own, _between_keys(shot, own)) for own in turns]
    return with_turns(shot, turns)


def with_turns(shot: Shot, turns: Sequence[Array | None]) -> Shot:
    """Return a shot whose cameras turn as was found."""
    if not any(own is not None for own in turns):
        return shot
    views = [
        view if own is None else replace(view, camera=view.camera.turned(own))
        for view, own in zip(shot.views, turns, strict=True)
    ]
    return replace(shot, views=tuple(views))


def turns_since(shot: Shot, given: Shot) -> Turns:
    """Return how the cameras of a shot turn and zoom that stand still in the given one."""
    return tuple(
        None if own.camera is before.camera else own.camera.turns_since(before.camera)
        for own, before in zip(shot.views, given.views, strict=True)
    )


def _shifts(shot: Shot, view: View, frames: Sequence[int]) -> bool:
    """Whether a view's background lies elsewhere on some of K shot frames than on the first of them.

    Who tracks footage that cannot be read says so.
    """
    if not view.camera.stands_still:
        return False
    factor = working_factor(view, shot.settings.working_size)
    masks = _posed_performers(shot, view.camera.reduced(factor).rectified())
    try:
        pictures = [*frames_at(view, [shot.frames[0] + f for f in frames], factor, grey=False)]
    except FootageError:
        return False
    return background_shift(pictures, [masks(f) for f in frames], frames, 1.0) is not None


def _posed_performers(shot: Shot, camera: Camera) -> Callable[[int], Bools]:
    """Return a function that returns where a camera roughly shows those with key poses on a shot frame, (h, w)."""
    posed = [performer for performer in shot.performers if len(performer.key_poses.frames)]
    if not posed:
        return lambda _frame: np.zeros(camera.size[::-1], bool)
    bodies = [performer.body for performer in posed]
    curves, geometry = [spline(performer.key_poses, shot.length) for performer in posed], Geometry.of(bodies)

    def shown(frame: int) -> Bools:
        poses = scene_poses(bodies, [curve[[frame]] for curve in curves])
        return np.asarray(render_labels(geometry, camera, 0, *poses).part[0] >= 0)

    return shown


def _measured(shot: Shot, view: View, calibrated: int) -> Array | None:
    """Return how a view's camera turns and zooms since a frame, shape (F, 3, 3), if it clearly does and most frames
    show it.
    """
    if not view.camera.stands_still:
        return None
    factor = working_factor(view, shot.settings.working_size)
    camera = view.camera.reduced(factor).rectified()
    pictures = frames_at(view, range(shot.frames[0], shot.frames[1] + 1), factor)
    found = background_turns(pictures, camera, _posed_performers(shot, camera), calibrated)
    if found is None:
        return None
    measured = np.flatnonzero(np.isfinite(found[:, 0, 0]))
    if len(measured) < _MIN_MEASURED * shot.length:
        return None
    frames = np.clip(np.arange(shot.length), measured[0], measured[-1])
    turns = interpolated(measured, found[measured], frames)
    turns = since(turns, turns[[calibrated]])
    shifted = np.count_nonzero(camera.displacements(turns) > MIN_SHIFT)
    return turns if shot.settings.stabilise or shifted >= _MIN_SHIFTED else None


def _set_by_eye(shot: Shot, turns: Sequence[Array | None]) -> bool:
    """Whether the key poses lie on the performers as pictures of cameras show them that turn, without allowing for it:
    as if these had stood still. Which of the two matches their movement better, in steady pictures, tells.
    """
    keys = whole_keys(shot, 0, shot.length - 1)
    frames = keys[evenly_spaced(len(keys), _MAX_COMPARED_KEYS)]
    if len(frames) < 2:
        return False
    geometry, poses, lacks = Geometry.of([p.body for p in shot.performers]), key_poses_of(shot, frames), np.zeros(2)
    for view, own in zip(shot.views, turns, strict=True):
        if own is None:
            continue
        factor, back = working_factor(view, shot.settings.working_size), np.swapaxes(split(own[frames])[0], 1, 2)
        camera = view.camera.reduced(factor).rectified()
        if camera.displacements(back).max() < MIN_SHIFT:  # a lens that only zooms tells nothing
            continue
        pictures = np.stack([*frames_at(view, (shot.frames[0] + frames).tolist(), factor, grey=False, turns=[*back])])
        matches = [movement_match(pictures, one, geometry, poses) for one in (camera, camera.turned(back))]
        lacks += [0.0 if match is None else 1 - match for match in matches]
    return bool(lacks[1] < lacks[0])


def _between_keys(shot: Shot, turns: Array) -> Array:
    """Return the turns (F, 3, 3) on the frames with key poses, interpolated on the others."""
    keys = whole_keys(shot, 0, shot.length - 1)
    frames = np.clip(np.arange(shot.length), keys[0], keys[-1])
    return interpolated(keys, turns[keys], frames)
