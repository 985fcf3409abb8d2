"""Poses on triangulated points, from which the fit of a motion to keypoints starts."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ...body import Body, landmark_positions
from ...body.inverse_kinematics import fit_poses
from ...body.limbs import MAIN_JOINTS
from ...body.motion import Motion, stacked
from ...numerics.arrays import Array
from ...shot.keypose_spline import spline
from ...shot.shot import KeyPoses
from ..keypoint_rays import Keypoints
from ..view_agreement import averaged, bridged
from .closed_form import closed_form_pose

POSE_INTERVAL = 0.2
"""Interval at which a body other than the default is posed by inverse kinematics, seconds; a curve joins these
poses."""
MIN_JOINT_SHARE = 2 / 3
"""To pose the body on a frame, this share of those main joints must be known there that are known on any frame."""
MIN_JOINTS = 3
"""To pose the body on a frame, at least this many main joints must be known there."""
MAX_START_DISTANCE = 0.25
"""A start is rejected if the median distance of its landmarks from the points is greater, metres."""


def posing_frames(keypoints: Keypoints, points_world: Array, fps: float) -> NDArray[np.intp]:
    """Return the frames to pose the body on: in each interval `POSE_INTERVAL`, the one on which most joints are
    known.
    """
    main = [i for i, name in enumerate(keypoints.names) if name.endswith(MAIN_JOINTS) and name not in MAIN_JOINTS]
    finite = np.isfinite(points_world[:, main]).all(axis=-1)
    known, enough = finite.sum(axis=1), max(MIN_JOINTS, MIN_JOINT_SHARE * finite.any(axis=0).sum())
    count = max(1, round(len(known) / (POSE_INTERVAL * fps)))
    best = [part[np.argmax(known[part])] for part in np.array_split(np.arange(len(known)), count)]
    return np.array([f for f in best if known[f] >= enough], dtype=np.intp)


def posing_points(keypoints: Keypoints, points_world: Array, fps: float) -> Array:
    """Return the points (F, L, 3) to pose the body on: those given, or, if they are too few on every frame, with
    straight lines across their gaps.
    """
    enough = len(posing_frames(keypoints, points_world, fps)) > 0
    return points_world if enough else bridged(points_world, fps)


def posed_start(body: Body, keypoints: Keypoints, points_world: Array, fps: float) -> Motion:
    """Return poses of all F frames on triangulated points (F, L, 3), from which leaps were removed.

    The default body is posed in closed form on every frame: a blow is shorter than `POSE_INTERVAL`, so a curve through
    fewer poses would miss it. Any other body is posed by inverse kinematics on some frames, each starting from the one
    before, and a curve joins these poses.
    """
    names = list(keypoints.names)
    closed_form = closed_form_pose(body, names, averaged(points_world, fps), fps)
    if closed_form is not None and landmark_distance(body, names, points_world, closed_form) < MAX_START_DISTANCE:
        return closed_form
    frames = posing_frames(keypoints, points_world, fps)
    poses: list[Motion] = []
    for frame in frames:
        target = points_world[[frame]]
        lost = bool(poses) and landmark_distance(body, names, target, poses[-1]) > MAX_START_DISTANCE
        poses.append(fit_poses(body, names, target, poses[-1] if poses and not lost else None))
    return spline(KeyPoses.whole(frames, stacked(poses)), len(keypoints))


def landmark_distance(body: Body, names: list[str], points_world: Array, pose: Motion) -> float:
    """Return the median distance of the landmarks of F poses from points (F, L, 3), metres."""
    used = [i for i, name in enumerate(names) if name in body.landmarks]
    found = landmark_positions(body, pose, [names[i] for i in used])
    return float(np.nanmedian(np.linalg.norm(found - points_world[:, used], axis=-1)))
