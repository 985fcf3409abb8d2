"""Derivatives of pictures by the twists of parts, as wrenches in camera axes (paper 1, equations (2) and (9))."""

from __future__ import annotations

import numpy as np

from ...numerics import rotations
from ...numerics.arrays import Array
from ..smoothed_images import Image


def wrenches(points: Image, slope: Image, focal: Image) -> Image:
    """Return the rows (m, x cross m) for brightness derivatives (2, N) at points in camera axes, shape (N, 6)."""
    x, y, z = points.T
    out = np.empty((6, len(points)), np.float32)
    mx, my = slope[0] * focal[0] / z, slope[1] * focal[1] / z
    mz = -(mx * x + my * y) / z
    out[:3] = mx, my, mz
    out[3:] = y * mz - z * my, z * mx - x * mz, x * my - y * mx
    return out.T


def camera_twist(R_cam_world: Array, t_cam_world: Array) -> Array:
    """Return matrices (..., 6, 6) that take twists (v, omega) about the world's origin to the camera's axes and
    centre.
    """
    A = np.zeros((*t_cam_world.shape[:-1], 6, 6))
    A[..., :3, :3] = A[..., 3:, 3:] = R_cam_world
    A[..., :3, 3:] = rotations.skew(t_cam_world) @ R_cam_world
    return A
