"""Covariances of the positions of joints, from the covariances of poses."""

from __future__ import annotations

import numpy as np

from ...body import Body, part_poses
from ...body.kinematics import point_jacobian, tip_positions
from ...body.motion import Motion
from ...numerics.arrays import Array

LARGEST_GROWTH = 5.0
"""Squared error of a fast tip relative to that of one at rest: because of motion blur, brightness that is not linear
over long distances, and clothes that lag."""
MOVING_DISPLACEMENT = 0.015
"""Displacement between two frames at which half of that growth is reached, metres."""


def tip_jacobian(body: Body, motion: Motion) -> Array:
    """Derivatives of the world positions of all parts' tips by the degrees of freedom, shape (F, P, 3, D)."""
    R, T = part_poses(body, motion)
    return point_jacobian(body, R, T, np.arange(len(body)), tip_positions(body, (R, T)))


def tip_covariances(jacobian: Array, covariances: Array) -> Array:
    """Covariances of the tips' positions, (F, P, 3, 3), square metres, from `tip_jacobian` and those of poses (F, D,
    D).
    """
    shape = jacobian.shape
    rows = (jacobian.reshape(len(jacobian), -1, shape[-1]) @ covariances).reshape(shape)
    return np.asarray(rows @ np.swapaxes(jacobian, -1, -2))


def growth_by_speed(body: Body, motion: Motion) -> Array:
    """Factor by which squared errors of the tips' positions exceed those at rest, by their speed, shape (F, P)."""
    if len(motion) < 2:
        return np.ones((len(motion), len(body)))
    speed = np.linalg.norm(np.gradient(tip_positions(body, part_poses(body, motion)), axis=0), axis=2)
    square = speed**2
    return np.asarray(1 + (LARGEST_GROWTH - 1) * square / (square + MOVING_DISPLACEMENT**2))
