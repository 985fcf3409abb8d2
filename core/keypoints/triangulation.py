"""Triangulation: points on which pairs of views agree, then least squares over the agreeing views by confidence."""

from __future__ import annotations

from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from ..numerics.arrays import Array, Ints
from ..numerics.likeliest_path import steadiest_path
from .keypoint_rays import Keypoints

INLIER_DISTANCE = 0.06
"""A view agrees with a point if its ray passes the point within this distance, metres."""
MIN_ANGLE = np.radians(3)
"""Two rays that meet at a smaller angle do not give a depth, radians."""
MAX_CANDIDATES = 6
"""How many candidate points are kept for each keypoint and frame, at most."""
LEAP_DISTANCE = 0.25
"""A point leaps if it is farther than this from its position on the frames around, metres."""
LEAP_TIME = 0.1
"""A leap is accepted if one view of full confidence agrees with it for this long, seconds."""


def triangulate(keypoints: Keypoints, fps: float | None = None) -> tuple[Array, NDArray[np.bool_]]:
    """Triangulate keypoints: the points on which the most views agree, weighted by confidence.

    Parameters
    ----------
    keypoints : Keypoints
    fps : float, optional
        Frame rate, if the frames follow one another. If pairs of views then agree on different points, the point that
        moves steadily is preferred to the one on which the most views agree on a single frame.

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
    found: list[Array] = []
    agreements: list[Array] = []
    for pair in combinations(range(V), 2):
        both = np.zeros_like(weight)
        both[list(pair)] = weight[list(pair)].min(axis=0)
        points = _solved(rows, values, both)
        points[~(_angle(keypoints, pair) > MIN_ANGLE)] = np.nan
        found.append(points)
        agreements.append(np.nan_to_num(_agreement(keypoints, points, weight)))
    P = len(found)
    candidates, agreed = np.array(found).reshape(P, F, L, 3), np.array(agreements).reshape(P, F, L)
    if len(agreed) > MAX_CANDIDATES:
        kept = np.argsort(-agreed, axis=0, kind="stable")[:MAX_CANDIDATES]
        candidates = np.take_along_axis(candidates, kept[..., None], axis=0)
        agreed = np.take_along_axis(agreed, kept, axis=0)
    best = np.full((F, L, 3), np.nan)
    for i in range(L):
        known = np.flatnonzero((agreed[:, :, i] > 0).any(axis=0))
        if not len(known):
            continue
        choice = agreed[:, known, i].argmax(axis=0)
        if fps is not None:
            choice = _steadiest(candidates[:, known, i], agreed[:, known, i], LEAP_TIME * fps)
        best[known, i] = candidates[choice, known, i]
    for _ in range(2):
        inliers = _distance(keypoints, best) < INLIER_DISTANCE
        depth = _depth(keypoints, best)
        sure = np.where(inliers, weight / np.maximum(depth, 0.1) ** 2, 0.0)
        refined = _solved(rows, values, sure)
        best = np.where(np.isfinite(refined), refined, best)
    inliers = _distance(keypoints, best) < INLIER_DISTANCE
    best[inliers.sum(axis=0) < 2] = np.nan
    return best, inliers & np.isfinite(best).all(axis=-1)


def least_squares_points(keypoints: Keypoints, weight: Array) -> Array:
    """Return the points nearest to the rays by weighted least squares over all views, metres, (F, L, 3); NaN where
    fewer than two views have a weight (V, F, L).
    """
    return _solved(*_equations(keypoints), weight)


def _steadiest(candidates: Array, agreed: Array, leap_cost: float) -> Ints:
    """Return the best of S candidates (S, F, 3) on every frame, shape (F,), by agreement (S, F) and by least
    acceleration.
    """
    S, F = agreed.shape
    cost = np.where(np.isfinite(candidates).all(axis=-1), -agreed, np.inf)
    if S < 2 or F < 3:
        return np.asarray(cost.argmin(axis=0))
    places = np.nan_to_num(candidates)

    def step(f: int) -> Array:
        a, b, c = places[:, f - 2, None, None], places[None, :, f - 1, None], places[None, None, :, f]
        leap = np.minimum(np.linalg.norm(a - 2 * b + c, axis=-1) / LEAP_DISTANCE, 1.0)
        return np.asarray(leap_cost * leap + cost[None, None, :, f])

    return steadiest_path(cost[:, 0, None] + cost[None, :, 1], step, F)


def _equations(keypoints: Keypoints) -> tuple[Array, Array]:
    """Linear equations a.x = b of both image axes: a with shape (V, F, L, 2, 3), b with (V, F, L, 2)."""
    R, t, rays = keypoints.R_cam_world[:, :, None], keypoints.t_cam_world[:, :, None], keypoints.rays
    rows = R[..., :2, :] - rays[..., None] * R[..., 2:, :]
    values = rays * t[..., 2:] - t[..., :2]
    return np.nan_to_num(rows), np.nan_to_num(values)


def _solved(rows: Array, values: Array, weight: Array) -> Array:
    """Solution of the equations by weighted least squares over the views; NaN if fewer than two have a weight."""
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
    """Distances of points from the rays, metres, shape (V, F, L); infinite where a view has no keypoint."""
    size = np.linalg.norm(keypoints.residuals(points), axis=-1)
    return np.where(np.isfinite(size), size, np.inf)


def _agreement(keypoints: Keypoints, points: Array, weight: Array) -> Array:
    error = np.minimum(_distance(keypoints, points) / INLIER_DISTANCE, 1.0)
    return np.asarray(np.sum(weight * (1 - error**2), axis=0))


def _angle(keypoints: Keypoints, pair: tuple[int, int]) -> Array:
    """Angle between the rays of two views, radians, shape (F, L)."""
    directions = []
    for v in pair:
        ray = np.concatenate([keypoints.rays[v], np.ones((*keypoints.rays.shape[1:3], 1))], axis=-1)
        world = np.einsum("fba,flb->fla", keypoints.R_cam_world[v], ray)
        directions.append(world / np.linalg.norm(world, axis=-1, keepdims=True))
    cosine = np.sum(directions[0] * directions[1], axis=-1)
    return np.asarray(np.arccos(np.clip(cosine, -1, 1)))
