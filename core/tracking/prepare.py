"""From the content of a shot file to a shot: reads the files that it names, and fits bodies and key poses to them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from ..body import part_poses
from ..body.unknown_parts import resting_parts
from ..cameras.camera import Camera
from ..errors import CalibrationError, ShotError, located
from ..formats.calibrations.calibration_files import load_cameras
from ..formats.keypoint_files import read_shot_keypoints
from ..formats.shot_toml import read_shot_spec
from ..keypoints.observations import performer_keypoints
from ..keypoints.proposals import KeypointPoses, poses_from_keypoints, propose_performers
from ..keypoints.seen_landmarks import unseen_parts
from ..runtime.progress import Progress, report_progress, share
from ..runtime.threads import one_library_thread, worker_count
from ..shot.footage import probe
from ..shot.footage_faults.footage_checks import camera_at_size, check_rates, check_view
from ..shot.footage_files.image_sequences import named_footage
from ..shot.grips import shot_with_grips
from ..shot.performer_request import PerformerRequest
from ..shot.shot import Performer, Shot, View
from ..shot.shot_spec import ShotSpec, ViewSpec
from .footage_reading.frames_ahead import FramesAhead
from .footage_reading.turned_cameras import with_early_turns
from .shot_scale import ShotScale
from .solvers.registry import REGISTRY, solver_named
from .spec_performers import performer_of

_STATE_UNIT = 'write unit = "mm" or unit = "cm" under [calibration]; unit = "m" if they really are that far apart'


def load_shot(
    path: Path | str,
    *,
    views: Sequence[str] | str | None = None,
    keyframes: Sequence[int] | NDArray[np.integer[Any]] | Literal["auto"] | None = None,
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
    cameras = _with_replaced(read_shot_cameras(spec), cameras or {}, spec)
    views = tuple(_view(view, cameras) for view in spec.views)
    length = spec.frames[1] - spec.frames[0] + 1
    # The footage is probed in other threads while bodies are fitted.
    with ThreadPoolExecutor(worker_count(spec.settings.threads)) as pool:
        checked = [pool.submit(check_view, view, spec.frames[0], length, spec.fps) for view in views]
        try:
            with nullcontext() if ahead is None else ahead.decoding(views):
                prepared = [performer_of(performer, spec.frames[0]) for performer in spec.performers]
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


def _with_replaced(known: Mapping[str, Camera], given: Mapping[str, Camera], spec: ShotSpec) -> dict[str, Camera]:
    """Return the cameras of the calibration, some of them replaced.

    Raises
    ------
    CalibrationError
        There is none of that name.
    """
    if unknown := given.keys() - known.keys():
        what = f"the calibration has no camera '{min(unknown)}' to be replaced"
        raise CalibrationError(what, where=str(spec.calibration), todo=f"it has {', '.join(known)}")
    return {**known, **given}


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
