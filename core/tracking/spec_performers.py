"""Performers as a shot file describes them: their bodies and key poses from the files that it names."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ..body import Body
from ..body.inverse_kinematics import fit_poses
from ..body.limbs import MAIN_JOINTS
from ..body.measures.measures_from_landmarks import fit_body
from ..body.prop import body_of_prop
from ..body.tip_landmarks import tip_misfits
from ..body.unknown_parts import resting_parts, unknown_parts
from ..errors import LandmarkError, ShotError, located
from ..formats.bvh import body_of_bvh, poses_of_bvh, read_bvh
from ..formats.obj_vertices import read_obj_vertices
from ..formats.trc import Landmarks, read_trc
from ..numerics.arrays import Array, Bools, Ints
from ..shot.performer_request import PerformerRequest
from ..shot.shot import KeyPoses, Performer
from ..shot.shot_spec import PerformerSpec

_MAIN_LANDMARKS = tuple(side + joint for joint in MAIN_JOINTS for side in "LR")
"""The main joints of both sides."""
_MIN_LANDMARKS = 4
"""Fewest main joints that a key pose needs; for people who are not wholly in the picture some are unknown."""

_MAX_NAMES, _MAX_NAME = 8, 24
"""How many of a file's names of landmarks an error lists at most, and with how many characters each."""


def performer_of(spec: PerformerSpec, first: int) -> Performer | PerformerRequest:
    """Return a performer or, where only keypoints show it, a request to be fulfilled from these.

    The frames of key poses are counted from the shot's first, which is frame `first` of the footage.

    Raises
    ------
    ShotError, LandmarkError, BodyError
        The message names the file and the field.
    """
    if spec.keyframes is None:
        todo = 'list the frames of the key poses, or write keyframes = "auto" if the views have keypoints'
        raise ShotError("'keyframes' is missing", where=spec.where, todo=todo)
    if spec.mesh is not None and (spec.keyposes is None or spec.keyframes == "auto" or spec.height is not None):
        todo = "give 'keyposes', a BVH file with one joint, and a list of 'keyframes'; a prop has no 'height'"
        raise ShotError("the key poses of a prop come from a BVH", where=spec.where, todo=todo)
    if spec.keyframes == "auto":
        return _request(spec, None)
    keys = np.array(spec.keyframes, dtype=np.int64)
    if spec.landmarks is not None and spec.keyposes is not None:
        what = "key poses come from a BVH or from landmarks, not from both"
        raise ShotError(what, where=f"{spec.where} keyposes")
    if spec.mesh is not None:
        return _prop(spec, spec.mesh, keys, first)
    if spec.keyposes is not None:
        return _posed_by_bvh(spec, spec.keyposes, keys, first)
    if spec.landmarks is not None:
        return _posed_by_landmarks(spec, spec.landmarks, keys, first)
    return _request(spec, tuple((keys - first).tolist()))


def _request(spec: PerformerSpec, frames: tuple[int, ...] | None) -> PerformerRequest:
    request = PerformerRequest(spec.name, spec.height, frames, spec.person)
    with located(spec.where):
        request.placeholder()  # raises for an impossible height
    return request


def _posed_by_bvh(spec: PerformerSpec, file: Path, keys: Ints, first: int) -> Performer:
    """Make a performer with key poses from a BVH file; see `PerformerSpec.rows`."""
    with located(f"{spec.where} keyposes"):
        skeleton = read_bvh(file)
        with located(str(file)):
            rows = spec.rows(keys, len(skeleton), first)
            body = body_of_bvh(skeleton, spec.height)
        poses = poses_of_bvh(skeleton, body, rows)
    keyed = KeyPoses.whole(keys - first, poses)
    return Performer(
        spec.name,
        body,
        keyed,
        spec.person,
        file_fps=skeleton.fps,
        file_rows=spec.uncounted(len(skeleton)),
        given_height=spec.height,
    )


def _prop(spec: PerformerSpec, mesh: Path, keys: Ints, first: int) -> Performer:
    """Make a prop: one part with the shape of a mesh, with its joint and key poses from a BVH file."""
    with located(f"{spec.where} mesh"):
        vertices = read_obj_vertices(mesh)
    assert spec.keyposes is not None
    with located(f"{spec.where} keyposes"):
        skeleton = read_bvh(spec.keyposes)
        with located(str(spec.keyposes)):
            rows = spec.rows(keys, len(skeleton), first)
            body = body_of_prop(skeleton.rest, vertices)
        poses = poses_of_bvh(skeleton, body, rows)
    keyed = KeyPoses.whole(keys - first, poses)
    return Performer(spec.name, body, keyed, file_fps=skeleton.fps, file_rows=spec.uncounted(len(skeleton)))


def _posed_by_landmarks(spec: PerformerSpec, file: Path, keys: Ints, first: int) -> Performer:
    """Fit the body and the key poses of a performer to landmarks; see `PerformerSpec.rows`."""
    with located(f"{spec.where} landmarks"):
        landmarks = read_trc(file)
        with located(str(file)):
            points = _landmarks_at(landmarks, keys, spec.rows(keys, len(landmarks), first))
    names, known = list(landmarks.names), np.isfinite(points).all(axis=-1)
    with located(spec.where):
        body = fit_body(names, points, spec.height)
        poses = fit_poses(body, names, points)
    unknown = _unknown_parts(body, names, known.any(axis=0))
    resting = set(resting_parts(body, unknown))
    free = np.zeros((len(keys), len(body)), bool)  # parts that other key poses show, but not this one
    for row, shown in zip(free, known, strict=True):
        row[sorted(set(resting_parts(body, _unknown_parts(body, names, shown))) - resting)] = True
    posed = KeyPoses.whole(keys - first, poses).without_parts(free)
    misfits = tip_misfits(body, names, points, poses)
    return Performer(
        spec.name,
        body,
        posed,
        spec.person,
        unknown,
        misfits,
        file_fps=landmarks.fps,
        file_rows=spec.uncounted(len(landmarks)),
        given_height=spec.height,
    )


def _unknown_parts(body: Body, names: Sequence[str], shown: Bools) -> tuple[str, ...]:
    return unknown_parts(body, [name for name, is_shown in zip(names, shown, strict=True) if is_shown])


def _landmarks_at(landmarks: Landmarks, keys: Ints, rows: Ints) -> Array:
    """Return the landmarks at the key frames alone, which are in some rows, shape (K, L, 3), metres."""
    points = landmarks.points_world[rows]
    main = [i for i, name in enumerate(landmarks.names) if name in _MAIN_LANDMARKS]
    if len(main) < _MIN_LANDMARKS:
        what = f"only {len(main)} of its {len(landmarks.names)} landmarks are main joints, of {_MIN_LANDMARKS} needed"
        named = ", ".join(name[:_MAX_NAME] for name in landmarks.names[:_MAX_NAMES])
        raise LandmarkError(what, todo=f"name them {', '.join(_MAIN_LANDMARKS)}; it has {named or 'none'}")
    for key, known in zip(keys, np.isfinite(points[:, main]).all(axis=-1).sum(axis=1), strict=True):
        if known < _MIN_LANDMARKS:
            what = f"only {known} of the main joints are known at key frame {key}; a key pose needs {_MIN_LANDMARKS}"
            raise LandmarkError(what, todo=f"choose another key frame; main joints are {', '.join(_MAIN_LANDMARKS)}")
    return np.asarray(points)
