"""Changing what one view does not show: poses that look nearly the same from a camera but differ in depth."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from ..body import Body, part_poses
from ..body.motion import Motion
from ..numerics import rotations
from ..numerics.arrays import Array


def leading_part(body: Body, landmark: str) -> int:
    """Return the index of the part that ends at a landmark, which is a joint or the tip of a part; -1 for the root's
    joint.
    """
    carrier, local = body.landmarks[landmark]
    return carrier if np.linalg.norm(local) > 0 else body.parents[carrier]


def limb_flipped(body: Body, pose: Motion, landmark: str, axis_world: Array) -> Motion:
    """Return a pose in which the part that ends at a landmark points towards the camera as far as it pointed away.

    Parameters
    ----------
    body : Body
    pose : Motion
        One pose.
    landmark : str
        A joint or the tip of a part. The pose is unchanged if that part is a collar bone or belongs to the trunk (it
        carries several parts).
    axis_world : ndarray, shape (3,)
        The camera's optical axis, a unit vector in the world frame.
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
    """Return poses moved away from a camera's centre (3,), world frame, by a distance along the root's ray, metres."""
    ray = pose.translations - centre_world
    return replace(pose, translations=pose.translations + distance * ray / np.linalg.norm(ray, axis=1, keepdims=True))
