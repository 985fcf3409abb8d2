"""From the content of a shot file to a shot: reads the files that it names, and fits bodies and key poses to them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ..body import Body, part_poses
from ..body.inverse_kinematics import fit_poses
from ..body.limbs import MAIN_JOINTS
from ..body.measures.measures_from_landmarks import fit_body
from ..body.prop import body_of_prop
from ..body.tip_landmarks import tip_misfits
from ..body.unknown_parts import resting_parts, unknown_parts
from ..cameras.camera import Camera
from ..errors import LandmarkError, ShotError, located
from ..formats.bvh import body_of_bvh, poses_of_bvh, read_bvh
from ..formats.calibrations.calibration_files import load_cameras
from ..formats.keypoint_files import read_shot_keypoints
from ..formats.obj_vertices import read_obj_vertices
from ..formats.shot_toml import read_shot_spec
from ..formats.trc import Landmarks, read_trc
from ..keypoints.observations import performer_keypoints
from ..keypoints.proposals import KeypointPoses, poses_from_keypoints, propose_performers
from ..keypoints.seen_landmarks import unseen_parts
from ..runtime.progress import Progress, report_progress, share
from ..runtime.threads import one_library_thread, worker_count
from ..shot.footage import probe
from ..shot.footage_faults.footage_checks import camera_at_size, check_rates, check_view
from ..shot.grips import shot_with_grips
from ..shot.image_sequences import named_footage
from ..shot.performer_request import PerformerRequest
from ..shot.shot import KeyPoses, Performer, Shot, View
from ..shot.shot_spec import PerformerSpec, ShotSpec, ViewSpec
from .frames_ahead import FramesAhead
from .shot_scale import ShotScale
from .solvers.registry import REGISTRY, solver_named
from .turned_cameras import with_early_turns

MAIN_LANDMARKS = tuple(side + joint for joint in MAIN_JOINTS for side in "LR")
"""The main joints of both sides."""
_STATE_UNIT = 'write unit = "mm" or unit = "cm" under [calibration]; unit = "m" if they really are that far apart'
MIN_LANDMARKS = 4
"""Fewest main joints that a key pose needs; for people who are not wholly in the picture some are unknown."""

_MAX_NAMES, _MAX_NAME = 8, 24
"""How many of a file's names of landmarks an error lists at most, and with how many characters each."""


def load_shot(
    path: Path | str,
    *,
    views: Sequence[str] | None = None,
    keyframes: Sequence[int] | Literal["auto"] | None = None,
    solver: str | None = None,
    cameras: Mapping[str, Camera] | None = None,
) -> Shot:
    """Read a shot file and prepare its shot.

    Parameters
    ----------
    path : path
        The shot file (.toml).
    views, keyframes, solver
        See `ShotSpec.selected`.
    cameras
        See `prepare_shot`.

    Raises
    ------
    KFMocapError
        The file, or one that it names, cannot be used; the message names file and field.
    """
    return prepare_shot(read_shot_spec(path).selected(views=views, keyframes=keyframes, solver=solver), cameras)


@one_library_thread()
def prepare_shot(spec: ShotSpec, cameras: Mapping[str, Camera] | None = None, ahead: FramesAhead | None = None) -> Shot:
    """Read everything that a shot file names except the pictures of the footage, and fit bodies and key poses.

    Parameters
    ----------
    spec : ShotSpec
    cameras : mapping of str to Camera, optional
        Cameras that replace those of the same name in the calibration.
    ahead : FramesAhead, optional
        Decodes the first frames meanwhile.

    Returns
    -------
    Shot
        Only the landmarks at key frames were used; the tracker never sees others.

    Raises
    ------
    ShotError, CalibrationError, FootageError, LandmarkError, KeypointError, BodyError
        The message names the file and the field.
    """
    cameras = read_shot_cameras(spec) | dict(cameras or {})
    views = tuple(_view(view, cameras) for view in spec.views)
    length = spec.frames[1] - spec.frames[0] + 1
    # The footage is probed in other threads while bodies are fitted.
    with ThreadPoolExecutor(worker_count(spec.settings.threads)) as pool:
        checked = [pool.submit(check_view, view, spec.frames[0], length, spec.fps) for view in views]
        try:
            with nullcontext() if ahead is None else ahead.decoding(views):
                prepared = [_performer(performer, spec.frames[0]) for performer in spec.performers]
        finally:
            footages = []
            for view, check in zip(views, checked, strict=True):
                with located(f"{spec.path} [[view]] '{view.camera.name}' footage"):
                    footages.append(check.result())
    unstated = [v for v, view in enumerate(spec.views) if view.every is None]
    with located(f"{spec.path} [[view]] footage"):
        check_rates([views[v] for v in unstated], [footages[v] for v in unstated], spec.fps)
    for performer in prepared:
        if isinstance(performer, Performer):
            _check_in_sight(performer, views, spec)
    requests = [p if isinstance(p, PerformerRequest) else None for p in prepared]
    performers = tuple(p.placeholder() if isinstance(p, PerformerRequest) else p for p in prepared)
    holds = tuple(hold.later(-spec.frames[0]) for hold in spec.holds)
    shot = Shot(
        name=spec.name,
        fps=spec.fps,
        frames=spec.frames,
        views=views,
        performers=performers,
        settings=spec.settings,
        holds=holds,
    )
    if any(requests):
        shot = replace(shot, performers=_from_keypoints(shot, requests, spec))
    shot = _with_fingers(shot, spec)
    return shot_with_grips(_with_parts_that_keypoints_show(shot))


def _with_fingers(shot: Shot, spec: ShotSpec) -> Shot:
    """Mark the performers whose fingers the shot file asks for."""
    for asked in spec.performers:
        if asked.fingers and sum(view.keypoints is not None for view in spec.views) < 2:
            todo = "name keypoints with hands in two views or more, or leave it out"
            raise ShotError("fingers are found in keypoints", where=f"{asked.where} fingers", todo=todo)
    fingers = [asked.fingers for asked in spec.performers]
    performers = tuple(replace(p, fingers=own) for p, own in zip(shot.performers, fingers, strict=True))
    return replace(shot, performers=performers)


def read_shot_cameras(spec: ShotSpec) -> dict[str, Camera]:
    """Read all cameras of a shot's calibration, by name, whether a view uses them or not.

    Those whose footage was resized are the cameras of the resized footage.

    Raises
    ------
    CalibrationError, FootageError
        One message that names the file and the field.
    """
    with located(f"{spec.path} [calibration] file"):
        cameras = {name: spec.world.ours(camera) for name, camera in load_cameras(spec.calibration).items()}
        with located(str(spec.calibration)):
            used = [cameras[view.camera] for view in spec.views if view.camera in cameras]
            spec.world.check(used, _STATE_UNIT)
    for view in spec.views if spec.resized else ():
        if view.camera in cameras:
            with located(f"{spec.path} [[view]] '{view.camera}' footage"):
                cameras[view.camera] = camera_at_size(cameras[view.camera], probe(view.footage).size, resized=True)
    return cameras


@one_library_thread()
def pose_by_keypoint_files(
    shot: Shot, frames: Sequence[int] | None = None, progress: Progress | None = None
) -> tuple[KeypointPoses, ...]:
    """Read the keypoints of a shot's views and fit every performer's motion to them; see `poses_from_keypoints`.

    Bodies of other sizes than people's are fitted at human size (`ShotScale`). Cameras that are held in the hand are
    followed (`with_early_turns`); where frames are given, they are as calibrated on the first with a key pose then.
    """
    report_progress(progress, "keypoints", 0.0)
    wanted = [] if frames is None else list(frames)
    keyed = [int(f) for performer in shot.performers for f in performer.key_poses.full()]
    shot = with_early_turns(shot, wanted, min([*wanted, *keyed], default=None))
    scale = ShotScale.of(shot)
    found = poses_from_keypoints(scale.shot(shot), read_shot_keypoints(shot), frames, share(progress, 0.1, 1.0))
    motions = scale.motions_back([own.motion for own in found], shot.performers)
    return tuple(replace(own, motion=motion) for own, motion in zip(found, motions, strict=True))


@one_library_thread()
def with_proposed_keys(shot: Shot) -> Shot:
    """Add key poses proposed from keypoints to a shot; its own key poses and its bodies do not change.

    Raises
    ------
    KeypointError
        The keypoints do not show a performer well enough.
    """
    performers = [
        replace(performer, key_poses=performer.key_poses.joined(found.key_poses()))
        for performer, found in zip(shot.performers, pose_by_keypoint_files(shot), strict=True)
    ]
    return replace(shot, performers=tuple(performers))


def _view(spec: ViewSpec, cameras: dict[str, Camera]) -> View:
    if spec.camera not in cameras:
        what, todo = f"the calibration has no camera '{spec.camera}'", f"its cameras are {', '.join(cameras)}"
        raise ShotError(what, where=f"{spec.where} camera", todo=todo)
    with located(f"{spec.where} footage"):
        footage = named_footage(spec.footage)
    every = 1 if spec.every is None else spec.every
    return View(cameras[spec.camera], footage, spec.offset, spec.fields, spec.keypoints, spec.gaps, every=every)


def _performer(spec: PerformerSpec, first: int) -> Performer | PerformerRequest:
    """Make the performer or, where only keypoints show it, a request to be fulfilled from these."""
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


def _check_in_sight(performer: Performer, views: Sequence[View], spec: ShotSpec) -> None:
    """Check that a performer is in some camera's picture on some key frame."""
    keys, body = performer.key_poses, performer.body
    joints = part_poses(body, keys.poses)[1]
    for view in views:
        for frame, points in zip(keys.frames, joints, strict=True):
            if view.camera.shows(view.camera.project(points, int(frame))).any():
                return
    todo = "check that they are of the same world as the calibration, and its unit and up axis"
    where = f"{spec.path} [[performer]] '{performer.name}'"
    raise ShotError("its key poses are in no camera's picture", where=where, todo=todo)


def _request(spec: PerformerSpec, frames: tuple[int, ...] | None) -> PerformerRequest:
    request = PerformerRequest(spec.name, spec.height, frames, spec.person)
    with located(spec.where):
        request.placeholder()  # raises for an impossible height
    return request


def _posed_by_bvh(spec: PerformerSpec, file: Path, keys: NDArray[np.int64], first: int) -> Performer:
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


def _prop(spec: PerformerSpec, mesh: Path, keys: NDArray[np.int64], first: int) -> Performer:
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


def _posed_by_landmarks(spec: PerformerSpec, file: Path, keys: NDArray[np.int64], first: int) -> Performer:
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


def _unknown_parts(body: Body, names: Sequence[str], shown: NDArray[np.bool_]) -> tuple[str, ...]:
    return unknown_parts(body, [name for name, is_shown in zip(names, shown, strict=True) if is_shown])


def _landmarks_at(landmarks: Landmarks, keys: NDArray[np.int64], rows: NDArray[np.int64]) -> NDArray[np.float64]:
    """Return the landmarks at the key frames alone, which are in some rows, shape (K, L, 3), metres."""
    points = landmarks.points_world[rows]
    main = [i for i, name in enumerate(landmarks.names) if name in MAIN_LANDMARKS]
    if len(main) < MIN_LANDMARKS:
        what = f"only {len(main)} of its {len(landmarks.names)} landmarks are main joints, of {MIN_LANDMARKS} needed"
        named = ", ".join(name[:_MAX_NAME] for name in landmarks.names[:_MAX_NAMES])
        raise LandmarkError(what, todo=f"name them {', '.join(MAIN_LANDMARKS)}; it has {named or 'none'}")
    for key, known in zip(keys, np.isfinite(points[:, main]).all(axis=-1).sum(axis=1), strict=True):
        if known < MIN_LANDMARKS:
            what = f"only {known} of the main joints are known at key frame {key}; a key pose needs {MIN_LANDMARKS}"
            raise LandmarkError(what, todo=f"choose another key frame; main joints are {', '.join(MAIN_LANDMARKS)}")
    return np.asarray(points)


def _with_parts_that_keypoints_show(shot: Shot) -> Shot:
    """Release the parts that no key pose shows, but keypoints do."""
    if not any(p.unknown for p in shot.performers) or not any(view.keypoints for view in shot.views):
        return shot
    performers = []
    owned = performer_keypoints(shot, read_shot_keypoints(shot))
    for performer, keypoints in zip(shot.performers, owned, strict=True):
        body, hidden = performer.body, unseen_parts(performer.body, keypoints)
        unknown = tuple(name for name in performer.unknown if name in hidden or not keypoints.confidence.any())
        free = np.zeros((len(performer.key_poses.frames), len(body)), bool)
        free[:, sorted(set(resting_parts(body, performer.unknown)) - set(resting_parts(body, unknown)))] = True
        performers.append(replace(performer, key_poses=performer.key_poses.without_parts(free), unknown=unknown))
    return replace(shot, performers=tuple(performers))


def _from_keypoints(shot: Shot, requests: Sequence[PerformerRequest | None], spec: ShotSpec) -> tuple[Performer, ...]:
    """Return all performers, with the requests fulfilled from keypoints."""
    where = next(s.where for s, request in zip(spec.performers, requests, strict=True) if request is not None)
    if not any(view.keypoints for view in shot.views):
        todo = "name a TRC file as landmarks, a BVH file as keyposes, or keypoints in the views"
        raise ShotError("there is nothing to take the key poses from", where=where, todo=todo)
    if not solver_named(shot.settings.solver).uses_keypoints:
        able = " or ".join(name for name, solver in REGISTRY.items() if solver.uses_keypoints)
        raise ShotError(f"key poses from keypoints need the solver {able}", where=where)
    with located(str(spec.path)):
        return propose_performers(with_early_turns(shot), read_shot_keypoints(shot), requests)
