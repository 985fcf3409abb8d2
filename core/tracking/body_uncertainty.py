"""The error of joints that footage cannot show: how far the joints of the model lie from the performer's."""

from __future__ import annotations

import numpy as np

from ..body import part_poses
from ..body.motion import Motion
from ..body.tip_landmarks import tip_landmarks
from ..keypoints.keypoint_places import OFFSET_DEVIATION, THINNESS, keypoint_on_body, offset_deviation
from ..keypoints.observations import PerformerKeypoints
from ..numerics.arrays import Array
from ..shot.shot import KeyPoses, Performer

USUAL_JOINT_DEVIATION = 0.003
"""Usual distance of the model's joints from the performer's where key poses were set by hand, metres."""
LIFTED_ERROR = 0.15
"""Usual error of joints whose depth follows from the lengths of bones in a single view, metres."""
LIFTED_WITHIN = 0.5
"""Time from a key pose of the whole body within which that error is smaller, seconds."""


def body_covariances(performer: Performer, motion: Motion, fps: float, observed: PerformerKeypoints | None) -> Array:
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
    """
    body, F = performer.body, len(motion)
    if observed is not None and not performer.key_poses.fixed.any():
        found = _offset_covariances(performer, motion)
    else:
        joints = np.full(len(body), USUAL_JOINT_DEVIATION)
        joints = joints if performer.joint_deviation is None else performer.joint_deviation
        found = np.broadcast_to((joints**2 / 3)[:, None, None] * np.eye(3), (F, len(body), 3, 3))
    if observed is not None and observed.is_lifted:
        away = np.minimum(frames_to_key_poses(performer.key_poses, F) / (LIFTED_WITHIN * fps), 1.0)
        found = found + ((LIFTED_ERROR * away) ** 2 / 3)[:, None, None, None] * np.eye(3)
    return found


def frames_to_key_poses(keys: KeyPoses, length: int) -> Array:
    """Return the distance of each frame from the nearest key pose of the whole body, frames, (F,); infinite without
    any.
    """
    away = np.abs(np.arange(length)[:, None] - keys.full()[None])
    return np.asarray(away.min(axis=1, initial=np.inf) if away.size else np.full(length, np.inf))


def _offset_covariances(performer: Performer, motion: Motion) -> Array:
    """Covariances of a detector's usual offsets from the joints, in the world, by the orientations of the parts."""
    body = performer.body
    at, usual = tip_landmarks(body), np.full((len(body), 3), OFFSET_DEVIATION)
    carriers = np.arange(len(body))
    for part, name in at.items():
        carriers[part], _ = keypoint_on_body(body, name)
        usual[part] = offset_deviation(name)
        if name.endswith(("Elbow", "Wrist", "Knee", "Ankle")):
            usual[part] /= THINNESS
    R = part_poses(body, motion)[0][:, carriers]
    return np.asarray((R * usual[:, None] ** 2) @ np.swapaxes(R, -1, -2))
