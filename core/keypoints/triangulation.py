"""Points in space from keypoints of several views: RANSAC over pairs of views, confidence-weighted least squares."""

from __future__ import annotations

from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from ..numerics.arrays import Array
from .keypoint_factor import Keypoints

ACCEPTED = 0.06
"""A view agrees with a point that is within this of its ray, metres."""
LEAST_ANGLE = np.radians(3)
"""Two rays that meet at less than this angle give no depth."""


def triangulate(keypoints: Keypoints) -> tuple[Array, NDArray[np.bool_]]:
    """Points on which the most views agree, weighed by confidence.

    Returns
    -------
    points_world : ndarray, shape (F, L, 3)
        Metres; NaN where no two views agree.
    inliers : ndarray of bool, shape (V, F, L)
        The views that agree.
    """
    V, F, L = keypoints.confidence.shape
    rows, values = _equations(keypoints)
    weight = keypoints.confidence * np.isfinite(keypoints.rays).all(axis=-1)
    best, score = np.full((F, L, 3), np.nan), np.zeros((F, L))
    for pair in combinations(range(V), 2):
        both = np.zeros_like(weight)
        both[list(pair)] = weight[list(pair)].min(axis=0)
        points = _solved(rows, values, both)
        points[~(_angle(keypoints, pair) > LEAST_ANGLE)] = np.nan
        agreed = _agreement(keypoints, points, weight)
        better = agreed > score
        best[better], score[better] = points[better], agreed[better]
    for _ in range(2):
        inliers = _distance(keypoints, best) < ACCEPTED
        depth = _depth(keypoints, best)
        sure = np.where(inliers, weight / np.maximum(depth, 0.1) ** 2, 0.0)
        refined = _solved(rows, values, sure)
        best = np.where(np.isfinite(refined), refined, best)
    inliers = _distance(keypoints, best) < ACCEPTED
    best[inliers.sum(axis=0) < 2] = np.nan
    return best, inliers & np.isfinite(best).all(axis=-1)


def _equations(keypoints: Keypoints) -> tuple[Array, Array]:
    """Rows a and values b of a.x = b, both image axes, shape (V, F, L, 2, 3) and (V, F, L, 2)."""
    R, t, rays = keypoints.R_cam_world[:, :, None], keypoints.t_cam_world[:, :, None], keypoints.rays
    rows = R[..., :2, :] - rays[..., None] * R[..., 2:, :]
    values = rays * t[..., 2:] - t[..., :2]
    return np.nan_to_num(rows), np.nan_to_num(values)


def _solved(rows: Array, values: Array, weight: Array) -> Array:
    """Weighted least squares over the views; NaN where fewer than two count."""
    A = np.einsum("vflka,vfl,vflkb->flab", rows, weight, rows)
    b = np.einsum("vflka,vfl,vflk->fla", rows, weight, values)
    enough = (weight > 0).sum(axis=0) >= 2
    A[~enough] = np.eye(3)
    A += 1e-9 * np.trace(A, axis1=-2, axis2=-1)[..., None, None] * np.eye(3)
    x = np.linalg.solve(A, b[..., None])[..., 0]
    x[~enough] = np.nan
    return x


def _depth(keypoints: Keypoints, points: Array) -> Array:
    R, t = keypoints.R_cam_world[:, :, 2], keypoints.t_cam_world[:, :, 2]
    return np.asarray(np.einsum("vfa,fla->vfl", R, points) + t[..., None])


def _distance(keypoints: Keypoints, points: Array) -> Array:
    """Metres across the rays, infinite where a view has no keypoint, shape (V, F, L)."""
    size = np.linalg.norm(keypoints.residuals(points), axis=-1)
    return np.where(np.isfinite(size), size, np.inf)


def _agreement(keypoints: Keypoints, points: Array, weight: Array) -> Array:
    error = np.minimum(_distance(keypoints, points) / ACCEPTED, 1.0)
    return np.asarray(np.sum(weight * (1 - error**2), axis=0))


def _angle(keypoints: Keypoints, pair: tuple[int, int]) -> Array:
    """Between the rays of two views, radians, shape (F, L)."""
    directions = []
    for v in pair:
        ray = np.concatenate([keypoints.rays[v], np.ones((*keypoints.rays.shape[1:3], 1))], axis=-1)
        world = np.einsum("fba,flb->fla", keypoints.R_cam_world[v], ray)
        directions.append(world / np.linalg.norm(world, axis=-1, keepdims=True))
    cosine = np.sum(directions[0] * directions[1], axis=-1)
    return np.asarray(np.arccos(np.clip(cosine, -1, 1)))
