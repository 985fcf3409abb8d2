"""Forward kinematics and the twist Jacobian of a body (paper 1, equations (3), (10), (11))."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ..numerics import rotations
from ..numerics.arrays import Array
from .body import Body
from .motion import Motion

Poses = tuple[Array, Array]
"""World rotations (F, P, 3, 3) and translations (F, P, 3) of parts."""


def part_poses(body: Body, motion: Motion) -> tuple[Array, Array]:
    """World rotation R (F, P, 3, 3) and joint T (F, P, 3) of every part; a part's point p is at R p + T."""
    F, P = len(motion), len(body)
    R, T = np.empty((F, P, 3, 3)), np.empty((F, P, 3))
    for i, p in enumerate(body.parents):
        if p < 0:
            R[:, i] = body.R_parent_rest[i] @ motion.rotations[:, i]
            T[:, i] = motion.translations
        else:
            R[:, i] = R[:, p] @ (body.R_parent_rest[i] @ motion.rotations[:, i])
            T[:, i] = T[:, p] + R[:, p] @ body.offsets[i]
    return R, T


def tip_positions(body: Body, poses: Poses) -> Array:
    """Tips of all parts in the world, metres, shape (F, P, 3)."""
    R, T = poses
    lengths = np.array([float(np.linalg.norm(part.tail_world - part.head_world)) for part in body.parts])
    return np.asarray(T + R[..., 1] * lengths[:, None])


def motion_of_poses(body: Body, poses: Poses) -> Motion:
    """Return the motion that has these poses of the parts; inverse of `part_poses`."""
    R, T = poses
    parents = [i if p < 0 else p for i, p in enumerate(body.parents)]
    before = np.swapaxes(R[:, parents], -1, -2)
    before[:, [i for i, p in enumerate(body.parents) if p < 0]] = np.eye(3)
    return Motion(T[:, 0], np.swapaxes(body.R_parent_rest, -1, -2) @ before @ R)


def landmark_positions(body: Body, motion: Motion, names: list[str]) -> Array:
    """Landmarks in the world, metres, shape (F, L, 3)."""
    parts, points = body.landmark_arrays(names)
    R, T = part_poses(body, motion)
    return np.asarray(np.einsum("flab,lb->fla", R[:, parts], points) + T[:, parts])


def twist_jacobian(body: Body, R: Array, T: Array) -> Array:
    """Twist of every part about the world's origin per unit of every degree of freedom.

    Parameters
    ----------
    R, T : ndarray, shape (F, P, 3, 3) and (F, P, 3)
        From `part_poses`.

    Returns
    -------
    ndarray, shape (F, P, 6, D)
        Rows: velocity of the body's point at the world's origin (3), angular velocity (3). A world point x of the
        part moves by v + omega x x. Degrees of freedom as in `Motion.moved`.
    """
    F, P = T.shape[:2]
    J = np.zeros((F, P, 6, body.dof))
    J[:, :, :3, :3] = np.eye(3)
    moments = rotations.skew(T) @ R  # T x axis, for each axis of part k
    for k in range(P):
        columns = slice(3 + 3 * k, 6 + 3 * k)
        below = np.flatnonzero(body.ancestry[:, k])
        J[:, below, :3, columns] = moments[:, None, k]
        J[:, below, 3:, columns] = R[:, None, k]
    return J


def point_jacobian(body: Body, R: Array, T: Array, parts: NDArray[np.int64], points_world: Array) -> Array:
    """Return the velocity of points fixed to parts per degree of freedom, shape (F, L, 3, D).

    Parameters
    ----------
    body : Body
    R, T : ndarray, shapes (F, P, 3, 3) and (F, P, 3)
        World poses of all parts.
    parts : ndarray of int, shape (L,)
        The part to which each point is fixed.
    points_world : ndarray, shape (F, L, 3)
        World frame, metres.
    """
    J = twist_jacobian(body, R, T)[:, parts]
    return J[..., :3, :] - rotations.skew(points_world) @ J[..., 3:, :]


def scene_poses(bodies: Sequence[Body], motions: Sequence[Motion]) -> Poses:
    """World poses (F, P, 3, 3) and (F, P, 3) of the parts of all performers, concatenated."""
    posed = [part_poses(body, motion) for body, motion in zip(bodies, motions, strict=True)]
    return np.concatenate([R for R, _ in posed], axis=1), np.concatenate([T for _, T in posed], axis=1)
