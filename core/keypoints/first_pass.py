"""A first pass: the motion of a whole shot as keypoints tell it, before any picture is looked at."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..body import Body, default_measures, human
from ..errors import KeypointError
from ..evidence.keypoints import Keypoints
from ..interpolation import spline
from ..inverse_kinematics import estimate_height, fit_poses
from ..motion import Motion
from ..shot import KeyPoses
from .fit import KeypointFit, fit_motion
from .triangulation import triangulate

Array = NDArray[np.float64]

KNOTS = 0.2
"""Inverse kinematics poses the body this often, seconds; between, a curve is the start."""
MAIN = ("Shoulder", "Elbow", "Wrist", "Hip", "Knee", "Ankle")
ENOUGH = 8
"""Main joints that must be known to pose the body."""


def first_pass(
    body: Body,
    keys: KeyPoses | None,
    keypoints: Keypoints,
    fixed: NDArray[np.bool_],
    precision: Array,
    fps: float,
    together: float,
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
    fps, together : float
        See `fit_motion`.

    Raises
    ------
    KeypointError
        There is no start: no key pose, and too few keypoints that two views share.
    """
    held = keys if keys is not None and keys.fixed.any() else None
    starts = [spline(held, len(keypoints))] if held is not None else []
    points, _ = triangulate(keypoints)
    if len(knots(keypoints, points, fps)):
        start = posed_start(body, keypoints, points, fps)
        if starts:
            start = start.moved(np.where(fixed, start.difference(starts[0]), 0.0))
        starts.append(start)
    if not starts:
        todo = "give key poses, or keypoints of two views or more"
        raise KeypointError("no two views agree on a pose of the body", todo=todo)
    fits = [fit_motion(body, keypoints, start, fixed, precision, together) for start in starts]
    return min(fits, key=lambda fit: fit.energy)


def scaled_first_pass(
    keypoints: Keypoints, fps: float, together: float, precision: Array, height: float | None = None
) -> KeypointFit:
    """Fit a motion and the body's measures to keypoints of two views or more; parameters as of `first_pass`."""
    points, _ = triangulate(keypoints)
    stature = estimate_height(keypoints.names, points) if height is None else height
    body = human(stature)
    start = posed_start(body, keypoints, points, fps)
    fixed = np.zeros((len(keypoints), body.dof), bool)
    return fit_motion(body, keypoints, start, fixed, precision, together, (stature, default_measures(stature)))


def knots(keypoints: Keypoints, points_world: Array, fps: float) -> NDArray[np.intp]:
    """Frames to pose the body on: of every fifth of a second the one on which most joints are known."""
    main = [i for i, name in enumerate(keypoints.names) if name.endswith(MAIN) and name not in MAIN]
    known = np.isfinite(points_world[:, main]).all(axis=-1).sum(axis=1)
    count = max(1, round(len(known) / (KNOTS * fps)))
    best = [part[np.argmax(known[part])] for part in np.array_split(np.arange(len(known)), count)]
    return np.array([f for f in best if known[f] >= ENOUGH], dtype=np.intp)


def posed_start(body: Body, keypoints: Keypoints, points_world: Array, fps: float) -> Motion:
    """A curve through poses fitted to triangulated keypoints."""
    frames = knots(keypoints, points_world, fps)
    if not len(frames):
        raise KeypointError("no two views agree on a pose of the body", todo="give key poses, or more views")
    poses = fit_poses(body, list(keypoints.names), points_world[frames])
    return spline(KeyPoses.whole(frames, poses), len(keypoints))
