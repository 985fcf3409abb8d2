"""Depth, which one view does not show: poses that look nearly the same from a camera and are nearer or farther."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from ..body import Body, part_poses
from ..body.motion import Motion
from ..numerics import rotations
from ..numerics.arrays import Array


def leading_part(body: Body, landmark: str) -> int:
    """Index of the part that leads to a landmark, a joint or the tip of a part; -1 for the root's joint."""
    carrier, local = body.landmarks[landmark]
    return carrier if np.linalg.norm(local) > 0 else body.parents[carrier]


def limb_flipped(body: Body, pose: Motion, landmark: str, axis_world: Array) -> Motion:
    """The pose with the part that leads to a landmark turned to point as far towards the camera as it pointed away.

    Parameters
    ----------
    body : Body
    pose : Motion
        One pose.
    landmark : str
        A joint or the tip of a part; where a part of the trunk leads to it, one that carries several, or a collar bone,
        the pose stays.
    axis_world : ndarray, shape (3,)
        The camera's optical axis, of length one.
    """
    (carrier, local), part = body.landmarks[landmark], leading_part(body, landmark)
    if part < 1 or body.parents.count(part) > 1 or body.is_stiff[part]:
        return pose
    R, T = (x[0] for x in part_poses(body, pose))
    limb = R[carrier] @ local + T[carrier] - T[part]
    other = limb - 2 * (limb @ axis_world) * axis_world
    turn = Rotation.align_vectors(other, limb)[0].as_matrix()
    rest = R[body.parents[part]] @ body.R_parent_rest[part]
    Q = pose.rotations.copy()
    Q[0, part] = rotations.orthonormal(rest.T @ turn @ rest @ Q[0, part])
    return replace(pose, rotations=Q)


def moved_in_depth(pose: Motion, centre_world: Array, distance: float) -> Motion:
    """Poses moved away from a camera's centre along the ray of the root's joint, metres."""
    ray = pose.translations - centre_world
    return replace(pose, translations=pose.translations + distance * ray / np.linalg.norm(ray, axis=1, keepdims=True))
