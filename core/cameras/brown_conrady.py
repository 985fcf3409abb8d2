"""Approximating a lens by a Brown distortion model, for programs that have no other.

D. C. Brown, Decentering distortion of lenses, Photogrammetric Engineering 32(3), 1966; here with four radial terms.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..numerics.arrays import Array
from .camera import Camera

_GRID = 48  # points on each side of the picture


@dataclass(frozen=True, eq=False)
class BrownModel:
    """A Brown model.

    Attributes
    ----------
    radial : ndarray, shape (4,)
        k1 to k4.
    tangential : ndarray, shape (2,)
        OpenCV's p1 and p2.
    error : float
        Largest distance between points of the footage under the Brown model and under the lens's own, pixels.
    """

    radial: Array
    tangential: Array
    error: float


def brown_model(camera: Camera) -> BrownModel:
    """Return the Brown model that comes closest to a camera's lens distortion.

    It is fitted by least squares over the points of the rectified picture that the footage shows. Distortion with up to
    five of OpenCV's coefficients is a Brown model already, and is returned unchanged.
    """
    if not camera.fisheye and not camera.distortions[5:].any():
        k1, k2, p1, p2, k3 = (*camera.distortions, 0.0, 0.0, 0.0, 0.0, 0.0)[:5]
        return BrownModel(np.array([k1, k2, k3, 0.0]), np.array([p1, p2]), 0.0)
    xy, target = _shown(camera)
    rows = _rows(xy)
    coefficients = np.linalg.lstsq(rows.reshape(-1, 6), (target - xy).ravel(), rcond=None)[0]
    apart = (xy + rows @ coefficients - target) * camera.matrix[[0, 1], [0, 1]]
    return BrownModel(coefficients[:4], coefficients[4:], float(np.linalg.norm(apart, axis=1).max()))


def _shown(camera: Camera) -> tuple[Array, Array]:
    """Return normalised coordinates (N, 2), undistorted and distorted, of points that both pictures show."""
    K, (width, height) = camera.matrix, camera.size
    u, v = np.meshgrid(np.linspace(0, width - 1, _GRID), np.linspace(0, height - 1, _GRID))
    xy = (np.stack([u, v], axis=-1).reshape(-1, 2) - K[:2, 2]) / K[[0, 1], [0, 1]]
    R, t = camera.pose(0)
    pixels = camera.project((np.column_stack([xy, np.ones(len(xy))]) - t) @ R)
    inside = camera.shows(pixels)
    return xy[inside], (pixels[inside] - K[:2, 2]) / K[[0, 1], [0, 1]]


def _rows(xy: Array) -> Array:
    """Return the derivatives of distorted coordinates (N, 2) by the six coefficients, shape (N, 2, 6)."""
    r2 = (xy**2).sum(axis=1, keepdims=True)
    radial = xy[:, :, None] * (r2 ** np.arange(1, 5))[:, None]
    x, y = xy.T
    tangential = np.stack(
        [np.stack([2 * x * y, r2[:, 0] + 2 * x**2], 1), np.stack([r2[:, 0] + 2 * y**2, 2 * x * y], 1)], 1
    )
    return np.concatenate([radial, tangential], axis=2)
