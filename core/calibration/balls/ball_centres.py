"""The image of a ball's centre, which is not the centre of its outline.

The rays to a ball's outline form a cone around the ray to its centre, which the image plane cuts obliquely. In a
pinhole camera of focal length 1, an outline with minor semi-axis b has its centre at (1 + b^2) times the image of the
ball's centre, measured from the principal point: with the ray at angle t to the axis and the cone's half angle s,
b^2 = sin^2 s / (cos^2 t - sin^2 s), and the outline extends from tan(t - s) to tan(t + s). Lens distortion bends the
outline and shifts its centre further.
"""

from __future__ import annotations

import cv2
import numpy as np

from ...numerics.arrays import Array

_OUTLINE_POINTS = 16  # points of a ball's outline that are projected
_ITERATIONS = 3  # of a fixed-point iteration
_CRITERIA = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 40, 1e-10)


def centres_of(points: Array, radii: Array, matrix: Array, distortions: Array) -> Array:
    """Return the images of balls' centres from their outlines.

    Parameters
    ----------
    points : ndarray, shape (..., 2)
        Centres of the outlines' ellipses, distorted pixels; NaN where there is none.
    radii : ndarray, shape (...)
        Their minor semi-axes, pixels.
    matrix : ndarray, shape (3, 3)
    distortions : ndarray, shape (k,)
        OpenCV's.

    Returns
    -------
    ndarray, shape (..., 2)
        Distorted pixels.
    """
    seen = np.isfinite(points).all(axis=-1)
    corrected = points.copy()
    if seen.any():
        outlines = points[seen]
        b = radii[seen] / matrix[0, 0] * _unbent(outlines, matrix, distortions)
        middles = outlines.copy()
        for _ in range(_ITERATIONS):
            middles = middles + outlines - outline_centres(middles, b, matrix, distortions)
        corrected[seen] = middles
    return corrected


def _unbent(points: Array, matrix: Array, distortions: Array) -> Array:
    """Return the factor by which undistorting lengthens distances perpendicular to the direction of the principal
    point.
    """
    bent = np.linalg.norm((points - matrix[:2, 2]) / matrix[[0, 1], [0, 1]], axis=1)
    straight = np.linalg.norm(_undistorted(points, matrix, distortions), axis=1)
    return np.where(bent > 1e-9, straight / np.maximum(bent, 1e-9), 1.0)


def _undistorted(points: Array, matrix: Array, distortions: Array) -> Array:
    return np.asarray(cv2.undistortPointsIter(points[:, None], matrix, distortions, None, None, _CRITERIA)[:, 0])


def outline_centres(middles: Array, b: Array, matrix: Array, distortions: Array) -> Array:
    """Return the centres of the outlines of balls, from the images of the balls' centres; inverse of `centres_of`.

    Parameters
    ----------
    middles : ndarray, shape (n, 2)
        Images of the balls' centres, distorted pixels.
    b : ndarray, shape (n,)
        Minor semi-axes of the outlines in a camera of focal length 1.
    matrix : ndarray, shape (3, 3)
    distortions : ndarray, shape (k,)
    """
    xy = _undistorted(middles, matrix, distortions)
    centre = xy * (1 + b**2)[:, None]
    # The axis away from the principal point: from (1 + b^2) x = sin t cos t / (cos^2 t - sin^2 s) and b.
    r = np.linalg.norm(xy, axis=1)
    out = np.where(r[:, None] > 1e-12, xy / np.maximum(r, 1e-12)[:, None], [1.0, 0.0])
    a = b * np.sqrt(1 + r**2 * (1 + b**2))
    angles = 2 * np.pi * np.arange(_OUTLINE_POINTS) / _OUTLINE_POINTS
    across = np.stack([-out[:, 1], out[:, 0]], axis=1)
    ring = centre[:, None] + (a[:, None] * np.cos(angles))[..., None] * out[:, None]
    ring = ring + (b[:, None] * np.sin(angles))[..., None] * across[:, None]
    rays = np.concatenate([ring, np.ones((*ring.shape[:2], 1))], axis=-1).reshape(-1, 1, 3)
    seen = cv2.projectPoints(rays, np.zeros(3), np.zeros(3), matrix, distortions)[0]
    return _ellipse_centres(seen.reshape(len(middles), _OUTLINE_POINTS, 2), angles)


def _ellipse_centres(outlines: Array, angles: Array) -> Array:
    """Return the centres of the ellipses that fit outlines (n, K, 2) best, by radial distances from the centre.

    The mean of a distorted outline's points is a different point, as its second harmonic shifts the ellipse, too.
    """
    circle = np.column_stack([np.cos(angles), np.sin(angles)])
    mean = outlines.mean(axis=1)
    shapes = 2 / len(angles) * np.einsum("nki,kj->nij", outlines, circle)
    distance = np.sum(np.linalg.solve(shapes, np.swapaxes(outlines - mean[:, None], 1, 2)) * circle.T, axis=1)
    return np.asarray(mean + np.einsum("nij,nk,kj->ni", shapes, distance, 2 / len(angles) * circle))
