"""Where the middle of a ball lies in its picture: not in the centre of its outline.

A ball is seen within a cone round the ray to its middle, and the picture's plane cuts that cone obliquely. In a
pinhole camera of focal length 1, an outline with minor semi-axis b has its centre at (1 + b^2) times the image of the
ball's middle, measured from the principal point: with the ray at angle t to the axis and the cone's half angle s,
b^2 = sin^2 s / (cos^2 t - sin^2 s), and the outline reaches from tan(t - s) to tan(t + s). A lens bends the outline,
which moves its centre again.
"""

from __future__ import annotations

import cv2
import numpy as np

from ..numerics.arrays import Array

_OUTLINE = 16  # points of a ball's outline that are projected
_ROUNDS = 3  # of a fixed-point iteration
_CRITERIA = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 40, 1e-10)


def centres_of(points: Array, radii: Array, matrix: Array, distortions: Array) -> Array:
    """Images of balls' middles from their outlines.

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
        for _ in range(_ROUNDS):
            middles = middles + outlines - outline_centres(middles, b, matrix, distortions)
        corrected[seen] = middles
    return corrected


def _unbent(points: Array, matrix: Array, distortions: Array) -> Array:
    """How much wider the lens would show what lies across the way to the principal point, without distortion."""
    bent = np.linalg.norm((points - matrix[:2, 2]) / matrix[[0, 1], [0, 1]], axis=1)
    straight = np.linalg.norm(_undistorted(points, matrix, distortions), axis=1)
    return np.where(bent > 1e-9, straight / np.maximum(bent, 1e-9), 1.0)


def _undistorted(points: Array, matrix: Array, distortions: Array) -> Array:
    return np.asarray(cv2.undistortPointsIter(points[:, None], matrix, distortions, None, None, _CRITERIA)[:, 0])


def outline_centres(middles: Array, b: Array, matrix: Array, distortions: Array) -> Array:
    """Centres of the outlines of balls whose middles are seen at some pixels.

    Parameters
    ----------
    middles : ndarray, shape (n, 2)
        Distorted pixels.
    b : ndarray, shape (n,)
        Minor semi-axis of the outline in a camera of focal length 1.
    """
    xy = _undistorted(middles, matrix, distortions)
    centre = xy * (1 + b**2)[:, None]
    # The axis away from the principal point: from (1 + b^2) x = sin t cos t / (cos^2 t - sin^2 s) and b.
    r = np.linalg.norm(xy, axis=1)
    out = np.where(r[:, None] > 1e-12, xy / np.maximum(r, 1e-12)[:, None], [1.0, 0.0])
    a = b * np.sqrt(1 + r**2 * (1 + b**2))
    angles = 2 * np.pi * np.arange(_OUTLINE) / _OUTLINE
    across = np.stack([-out[:, 1], out[:, 0]], axis=1)
    ring = centre[:, None] + (a[:, None] * np.cos(angles))[..., None] * out[:, None]
    ring = ring + (b[:, None] * np.sin(angles))[..., None] * across[:, None]
    rays = np.concatenate([ring, np.ones((*ring.shape[:2], 1))], axis=-1).reshape(-1, 1, 3)
    seen = cv2.projectPoints(rays, np.zeros(3), np.zeros(3), matrix, distortions)[0]
    return _ellipse_centres(seen.reshape(len(middles), _OUTLINE, 2), angles)


def _ellipse_centres(outlines: Array, angles: Array) -> Array:
    """Centres of the ellipses that fit outlines (n, K, 2) best, as `balls` fits them: by the distance from the middle.

    A bent outline's mean is another point: its second harmonic shifts the ellipse, too.
    """
    circle = np.column_stack([np.cos(angles), np.sin(angles)])
    mean = outlines.mean(axis=1)
    shapes = 2 / len(angles) * np.einsum("nki,kj->nij", outlines, circle)
    distance = np.sum(np.linalg.solve(shapes, np.swapaxes(outlines - mean[:, None], 1, 2)) * circle.T, axis=1)
    return np.asarray(mean + np.einsum("nij,nk,kj->ni", shapes, distance, 2 / len(angles) * circle))
