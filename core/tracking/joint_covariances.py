"""From covariances of poses to those of the places of joints."""

from __future__ import annotations

import numpy as np

from ..body import Body, part_poses
from ..body.kinematics import point_jacobian, tip_positions
from ..body.motion import Motion
from ..numerics.arrays import Array

STEADY = 0.015
"""Movement from one frame to the next at which squared errors of a part's tip are twice those at rest, metres: blur,
brightness that is not linear over such distances, and clothes that lag."""


def tip_jacobian(body: Body, motion: Motion) -> Array:
    """Derivatives of the places of all parts' tips by the degrees of freedom, shape (F, P, 3, D)."""
    R, T = part_poses(body, motion)
    return point_jacobian(body, R, T, np.arange(len(body)), tip_positions(body, (R, T)))


def tip_covariances(jacobian: Array, covariances: Array) -> Array:
    """Covariances of the tips' places, (F, P, 3, 3), metres squared, of `tip_jacobian` and the poses' (F, D, D)."""
    shape = jacobian.shape
    rows = (jacobian.reshape(len(jacobian), -1, shape[-1]) @ covariances).reshape(shape)
    return np.asarray(rows @ np.swapaxes(jacobian, -1, -2))


def growth_by_speed(body: Body, motion: Motion) -> Array:
    """By how much squared errors of the tips' places are larger than at rest, shape (F, P)."""
    if len(motion) < 2:
        return np.ones((len(motion), len(body)))
    speed = np.linalg.norm(np.gradient(tip_positions(body, part_poses(body, motion)), axis=0), axis=2)
    return np.asarray(1 + (speed / STEADY) ** 2)
