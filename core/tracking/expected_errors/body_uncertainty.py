"""The error of joints that footage cannot show: how far the joints of the model lie from the performer's, and how deep
they are in a single view.
"""

from __future__ import annotations

import numpy as np

from ...body import part_poses
from ...body.kinematics import tip_positions
from ...body.limbs import limbs
from ...body.motion import Motion
from ...body.tip_landmarks import tip_landmarks
from ...keypoints.keypoint_offsets import OFFSET_SIGMA, THINNESS, keypoint_on_body, offset_sigma
from ...keypoints.observations import PerformerKeypoints
from ...numerics.arrays import Array, Ints
from ...shot.shot import KeyPoses, Performer

USUAL_JOINT_SIGMA = 0.003
"""Usual distance of the model's joints from the performer's where key poses were set by hand, metres."""
LIFTED_ERROR = 0.15
"""Usual error of joints whose depth follows from the lengths of bones in a single view, metres."""
LIFTED_DEPTH = 0.16
"""Standard deviation of such a joint's depth against the hips, beside that error, metres."""
LIFTED_DISTANCE_SHARE = 0.04
"""Standard deviation of the person's distance from that view's camera, as a share of it."""
LIFTED_WITHIN = 0.5
"""Time from a key pose of the whole body within which these errors are smaller, seconds."""
LIMB_DEPTH_SHARE = 0.35
"""Standard deviation of a joint's depth per distance that it has moved against the beginning of its limb since a key
pose: without keypoints, a single view hardly shows whether a limb has moved towards it or away."""
DEPTH_DRIFT = 0.04
"""Variance of a joint's depth per distance from where a key pose has it, metres squared per metre: with keypoints in a
single view, depth follows from how short a bone seems, and a detector's error there stays the same for long."""


def body_covariances(
    performer: Performer, motion: Motion, fps: float, observed: PerformerKeypoints | None, eye: Array | None = None
) -> Array:
    """Covariances of the differences between the tips of the model's parts and the performer's joints, (F, P, 3, 3), in
    square metres.

    With key poses they follow from the distances between landmarks and tips. With keypoints alone the model is where
    the detector sees the performer, so the detector's unknown constant offsets from the joints are added.

    Parameters
    ----------
    performer : Performer
    motion : Motion
        F poses.
    fps : float
    observed : PerformerKeypoints, optional
        The performer's keypoints, if there are any.
    eye : ndarray, shape (F, 3), optional
        Centre of the camera on every frame, world, metres, if there is a single one.
    """
    body, F = performer.body, len(motion)
    if observed is not None and not performer.key_poses.fixed.any():
        found = _offset_covariances(performer, motion)
    else:
        joints = np.full(len(body), USUAL_JOINT_SIGMA)
        joints = joints if performer.joint_deviation is None else performer.joint_deviation
        found = np.broadcast_to((joints**2 / 3)[:, None, None] * np.eye(3), (F, len(body), 3, 3))
    away = np.minimum(frames_to_key_poses(performer.key_poses, F) / (LIFTED_WITHIN * fps), 1.0)[:, None]
    is_lifted = observed is not None and observed.is_lifted
    if is_lifted:
        found = found + ((LIFTED_ERROR * away) ** 2 / 3)[..., None, None] * np.eye(3)
    if eye is None:
        return found
    poses = part_poses(body, motion)
    tips = tip_positions(body, poses)
    sight = tips - eye[:, None]
    distance = np.linalg.norm(sight, axis=-1)
    if is_lifted:
        variance = away**2 * (LIFTED_DEPTH**2 + (LIFTED_DISTANCE_SHARE * distance) ** 2)
    else:
        variance = _depth_variances(performer, poses[1], tips, keypoints=observed is not None)
    sight /= distance[..., None]
    return np.asarray(found + variance[..., None, None] * sight[..., :, None] * sight[..., None, :])


def _depth_variances(performer: Performer, joints: Array, tips: Array, *, keypoints: bool) -> Array:
    """Variances of the tips (F, P, 3) of a body's parts along the line of sight of a single camera between key poses,
    (F, P), square metres.

    With keypoints, they follow from how far the tips are from where the nearest key pose has them; without, from how
    far they have moved against the beginnings of their limbs, which are among the joints (F, P, 3).
    """
    keys = performer.key_poses.full()
    if keypoints:
        return DEPTH_DRIFT * _distances(tips, keys)
    variance = np.zeros(tips.shape[:2])
    for chain in limbs(performer.body):
        moved = _distances(tips[:, chain] - joints[:, chain[:1]], keys)
        variance[:, chain] = (LIMB_DEPTH_SHARE * moved) ** 2
    return variance


def _distances(points: Array, frames: Ints) -> Array:
    """Distances of points (F, N, 3) from where they are on the nearest of some frames, (F, N); 0 without frames."""
    away = [np.linalg.norm(points - points[frame], axis=-1) for frame in frames]
    return np.asarray(np.min(away, axis=0)) if away else np.zeros(points.shape[:2])


def frames_to_key_poses(keys: KeyPoses, length: int) -> Array:
    """Return the distance of each frame from the nearest key pose of the whole body, frames, (F,); infinite without
    any.
    """
    away = np.abs(np.arange(length, dtype=float)[:, None] - keys.full()[None])
    return np.asarray(away.min(axis=1, initial=np.inf))


def _offset_covariances(performer: Performer, motion: Motion) -> Array:
    """Covariances of a detector's usual offsets from the joints, in the world, by the orientations of the parts."""
    body = performer.body
    at, usual = tip_landmarks(body), np.full((len(body), 3), OFFSET_SIGMA)
    carriers = np.arange(len(body))
    for part, name in at.items():
        carriers[part], _ = keypoint_on_body(body, name)
        usual[part] = offset_sigma(name)
        if name.endswith(("Elbow", "Wrist", "Knee", "Ankle")):
            usual[part] /= THINNESS
    R = part_poses(body, motion)[0][:, carriers]
    return np.asarray((R * usual[:, None] ** 2) @ np.swapaxes(R, -1, -2))
