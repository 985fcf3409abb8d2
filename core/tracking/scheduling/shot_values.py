"""Checks of the values of a shot that was built in Python; those of a shot file are checked as it is read."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ...errors import ShotError
from ...numerics import rotations
from ...numerics.sequences import first_repeated
from ...shot.shot import FIELD_ORDERS, Performer, Shot, View


def check_values(shot: Shot) -> None:
    """Check that a shot has views and performers, and that all their values can be true.

    Raises
    ------
    ShotError
        One cannot: names the view or performer, and the field.
    """
    where = f"shot {shot.name}"
    if len(shot.frames) != 2 or not all(_is_whole(frame) for frame in shot.frames):
        raise ShotError(
            f"frames is {shot.frames}", where=where, todo="give the first and the last frame, whole numbers"
        )
    if not (np.isfinite(shot.fps) and shot.fps > 0):
        raise ShotError(f"fps is {shot.fps}", where=where, todo="give frames per second")
    for what, names in (
        ("view", [view.camera.name for view in shot.views]),
        ("performer", [performer.name for performer in shot.performers]),
    ):
        if not names:
            raise ShotError(f"there is no {what}", where=where)
        if (name := first_repeated(names)) is not None:
            raise ShotError(f"there are two {what}s '{name}'", where=where, todo="give each a name of its own")
    for view in shot.views:
        _check_view(view)
    for performer in shot.performers:
        _check_key_poses(performer, shot.length)


def _check_view(view: View) -> None:
    for name, right, todo in (
        ("footage", isinstance(view.footage, Path), "give a pathlib.Path"),
        ("keypoints", view.keypoints is None or isinstance(view.keypoints, Path), "give a pathlib.Path"),
        ("offset", np.isfinite(view.offset), "give a number of frames"),
        ("every", _is_whole(view.every) and view.every > 0, "give a whole number from 1"),
        ("fields", view.fields in FIELD_ORDERS, f"give one of {', '.join(FIELD_ORDERS)}"),
    ):
        if not right:
            raise ShotError(f"{name} is {getattr(view, name)!r}", where=f"view {view.camera.name}", todo=todo)


def _check_key_poses(performer: Performer, length: int) -> None:
    """Check the frames of a performer's key poses, and that its body can have these poses."""
    where, keys = f"performer {performer.name}", performer.key_poses
    frames, poses, parts = keys.frames, keys.poses, len(performer.body)
    shapes = (poses.translations.shape, poses.rotations.shape, keys.fixed.shape)
    if shapes != ((len(frames), 3), (len(frames), parts, 3, 3), (len(frames), 3 + 3 * parts)):
        what = f"{len(frames)} key frames, but translations, rotations and fixed degrees of freedom of shapes {shapes}"
        raise ShotError(what, where=where, todo=f"give a pose of the body's {parts} parts for each frame")
    if (np.diff(frames) <= 0).any() or ((frames < 0) | (frames >= length)).any():
        todo = f"they count from the shot's first frame and increase: 0 to {length - 1}"
        raise ShotError(f"its key frames are {', '.join(map(str, frames[:20]))}", where=where, todo=todo)
    sound = rotations.are_rotations(poses.rotations).all(axis=1) & np.isfinite(poses.translations).all(axis=1)
    for frame in frames[~sound][:1]:
        todo = "translations are finite numbers, and rotations neither scale nor mirror"
        raise ShotError(f"its key pose on frame {frame} is not a pose", where=where, todo=todo)


def _is_whole(value: object) -> bool:
    return isinstance(value, int | np.integer)
