"""A first pass: the motion of a whole shot by keypoints alone, before any picture is looked at."""

from __future__ import annotations

import warnings

import numpy as np
from numpy.typing import NDArray

from ..body import Body, landmark_positions
from ..body.inverse_kinematics import estimate_height, fit_poses
from ..body.motion import Motion, stacked
from ..errors import KeypointError
from ..shot.keypose_spline import spline
from ..shot.shot import KeyPoses
from .body_measures import BodyMeasures
from .closed_form import closed_form_pose
from .keypoint_factor import Keypoints
from .keypoint_fit import KeypointFit, fit_motion
from .triangulation import triangulate

Array = NDArray[np.float64]

POSED_EVERY = 0.2
"""Inverse kinematics poses the body this often, seconds; between, a curve is the start."""
MAIN = ("Shoulder", "Elbow", "Wrist", "Hip", "Knee", "Ankle")
ENOUGH = 8
"""Main joints that must be known to pose the body."""
COMPARED_WITHIN = 0.1
"""How long before and after a point is compared with, seconds."""
LEAP = 0.25
"""A point farther from the others' median is wrong, metres."""
LOST = 0.25
"""Poses whose landmarks are farther off, in the median, are no start, metres."""


def first_pass(
    body: Body,
    keys: KeyPoses | None,
    keypoints: Keypoints,
    *,
    fixed: NDArray[np.bool_],
    precision: Array,
    fps: float,
    correlated: float,
) -> KeypointFit:
    """Fit a body's motion to keypoints, from the better of two starts.

    Parameters
    ----------
    body : Body
    keys : KeyPoses or None
        The curve through them is a start.
    keypoints : Keypoints
        On the F frames of the shot.
    fixed : ndarray of bool, shape (F, D)
        Degrees of freedom that key poses hold, or that are locked.
    precision : ndarray, shape (D,)
        Of accelerations.
    fps : float
    correlated : float
        See `fit_motion`.

    Raises
    ------
    KeypointError
        There is no start: no key pose, and too few keypoints that two views share.
    """
    held = keys if keys is not None and keys.fixed.any() else None
    starts = [spline(held, len(keypoints))] if held is not None else []
    points, _ = triangulate(keypoints)
    if len(posing_frames(keypoints, without_leaps(points, fps), fps)):
        start = posed_start(body, keypoints, points, fps)
        if starts:
            start = start.moved(np.where(fixed, start.difference(starts[0]), 0.0))
        starts.append(start)
    if not starts:
        todo = "give key poses, or keypoints of two views or more"
        raise KeypointError("no two views agree on a pose of the body", todo=todo)
    fits = [
        fit_motion(body, keypoints, start, fixed=fixed, precision=precision, correlated=correlated) for start in starts
    ]
    return min(fits, key=lambda fit: fit.energy)


def scaled_first_pass(
    keypoints: Keypoints, *, fps: float, precision: Array, correlated: float, height: float | None = None
) -> KeypointFit:
    """Fit a motion and the body's measures to keypoints of two views or more.

    Parameters
    ----------
    keypoints : Keypoints
        On the F frames of the shot.
    fps : float
    precision : ndarray, shape (D,)
        Of accelerations.
    correlated : float
        See `fit_motion`.
    height : float, optional
        Of the body, metres; by default estimated from the keypoints.

    Raises
    ------
    KeypointError
        There are too few keypoints that two views share.
    """
    points, _ = triangulate(keypoints)
    if not len(posing_frames(keypoints, without_leaps(points, fps), fps)):
        raise KeypointError("no two views agree on a pose of the body", todo="give key poses, or more views")
    measures = BodyMeasures.average(estimate_height(keypoints.names, points) if height is None else height)
    body = measures.body()
    start = posed_start(body, keypoints, points, fps)
    fixed = np.zeros((len(keypoints), body.dof), bool)
    return fit_motion(
        body, keypoints, start, fixed=fixed, precision=precision, correlated=correlated, measures=measures
    )


def posing_frames(keypoints: Keypoints, points_world: Array, fps: float) -> NDArray[np.intp]:
    """Return the frames to pose the body on: of every fifth of a second the one on which most joints are known."""
    main = [i for i, name in enumerate(keypoints.names) if name.endswith(MAIN) and name not in MAIN]
    known = np.isfinite(points_world[:, main]).all(axis=-1).sum(axis=1)
    count = max(1, round(len(known) / (POSED_EVERY * fps)))
    best = [part[np.argmax(known[part])] for part in np.array_split(np.arange(len(known)), count)]
    return np.array([f for f in best if known[f] >= ENOUGH], dtype=np.intp)


def posed_start(body: Body, keypoints: Keypoints, points_world: Array, fps: float) -> Motion:
    """Return a curve through poses on triangulated keypoints.

    They are in closed form for the default body, else fitted by inverse kinematics, each from the one before.
    """
    points = without_leaps(points_world, fps)
    frames = posing_frames(keypoints, points, fps)
    names = list(keypoints.names)
    closed_form = closed_form_pose(body, names, points[frames])
    if closed_form is not None and landmark_distance(body, names, points[frames], closed_form) < LOST:
        return spline(KeyPoses.whole(frames, closed_form), len(keypoints))
    poses: list[Motion] = []
    for frame in frames:
        target = points[[frame]]
        lost = bool(poses) and landmark_distance(body, names, target, poses[-1]) > LOST
        poses.append(fit_poses(body, names, target, poses[-1] if poses and not lost else None))
    return spline(KeyPoses.whole(frames, stacked(poses)), len(keypoints))


def without_leaps(points_world: Array, fps: float) -> Array:
    """Return points, NaN where one leaps away from where it is before and after."""
    half = max(1, round(COMPARED_WITHIN * fps))
    padded = np.pad(points_world, ((half, half), (0, 0), (0, 0)), constant_values=np.nan)
    around = np.stack([padded[k : k + len(points_world)] for k in range(2 * half + 1)])
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # of points that are nowhere known
        middle = np.nanmedian(around, axis=0)
    leaps = np.linalg.norm(points_world - middle, axis=-1) > LEAP
    return np.where(leaps[..., None], np.nan, points_world)


def landmark_distance(body: Body, names: list[str], points_world: Array, pose: Motion) -> float:
    """Return the median distance of a pose's landmarks from points (F, L, 3), metres."""
    used = [i for i, name in enumerate(names) if name in body.landmarks]
    found = landmark_positions(body, pose, [names[i] for i in used])
    return float(np.nanmedian(np.linalg.norm(found - points_world[:, used], axis=-1)))
