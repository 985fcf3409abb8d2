"""Whether two tracks of different views show one person: their rays meet, and further views confirm the points.

In views from similar heights, everybody is seen at the same height, so that rays to two different people often meet
almost as well as rays to one. Therefore a third view must confirm the points, and the distances between them must be
those of a body.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from ...numerics.arrays import Array, Bools, Ints
from .detected_points import DetectedPoints, median_known
from .tracks import Track

MAX_RAY_DISTANCE = 0.15
"""Largest distance between two rays to the same point of one person, metres."""
TRUNK_LENGTH_RANGE = (0.2, 0.9)
"""Least and greatest distance between the middle of the shoulders and the middle of the hips, metres."""
MAX_BONE_LENGTH = 0.8
"""Greatest distance between the middle of two joints and the middle of the next two along the body, metres."""
_CHAIN = ("Shoulder", "Hip", "Knee", "Ankle")


def overlapping_tracks(tracks: Sequence[Track]) -> Bools:
    """Return which tracks are of different views and have frames in common, or may have, shape (n, n)."""
    ends = np.array([(t.view, t.frames[0], t.frames[-1]) for t in tracks]).reshape(-1, 3)
    views, first, last = (column[:, None] for column in ends.T)
    return np.asarray((views != views.T) & (first <= last.T) & (last >= first.T))


def agreement(
    detected: DetectedPoints, tracks: Sequence[Track], rays: Sequence[Array], pair: tuple[int, int], others: Ints
) -> float:
    """Return how strongly it is confirmed that two tracks of different views show one person: the number of frames on
    which they agree, and of further views that agree there. `others` are the tracks of other views at that time.
    """
    first, second = tracks[pair[0]], tracks[pair[1]]
    frames, rows_a, rows_b = np.intersect1d(first.frames, second.frames, assume_unique=True, return_indices=True)
    if not len(frames):
        return 0.0
    points, gap = _nearest(
        detected.origins(first.view, frames)[:, None],
        rays[pair[0]][rows_a],
        detected.origins(second.view, frames)[:, None],
        rays[pair[1]][rows_b],
    )
    agreed = np.maximum(1 - median_known(gap) / MAX_RAY_DISTANCE, 0) * _has_body_size(detected.empty.names, points)
    if not agreed.any():
        return 0.0
    best: dict[int, Array] = {}
    for k in others:
        other = tracks[k]
        shared, here, there = np.intersect1d(frames, other.frames, assume_unique=True, return_indices=True)
        if len(shared):
            from_camera = points[here] - detected.origins(other.view, shared)[:, None]
            away = np.linalg.norm(np.cross(from_camera, rays[k][there]), axis=-1)
            confirmed = best.setdefault(other.view, np.zeros(len(frames)))
            confirmed[here] = np.maximum(confirmed[here], np.maximum(1 - median_known(away) / MAX_RAY_DISTANCE, 0))
    return float((agreed * (1 + sum(best.values(), np.zeros(len(frames))))).sum())


def _nearest(origin_a: Array, ray_a: Array, origin_b: Array, ray_b: Array) -> tuple[Array, Array]:
    """Return the point where two rays are nearest to each other, and their distance there; NaN if it is behind a
    camera.
    """
    between = origin_b - origin_a
    cosine = (ray_a * ray_b).sum(axis=-1)
    along_a, along_b = (ray_a * between).sum(axis=-1), (ray_b * between).sum(axis=-1)
    sine = 1 - cosine**2
    with np.errstate(invalid="ignore", divide="ignore"):
        s, t = (along_a - cosine * along_b) / sine, (cosine * along_a - along_b) / sine
    met = (s > 0) & (t > 0) & (sine > 1e-3)
    a, b = origin_a + s[..., None] * ray_a, origin_b + t[..., None] * ray_b
    return np.where(met[..., None], (a + b) / 2, np.nan), np.where(met, np.linalg.norm(a - b, axis=-1), np.nan)


def _has_body_size(names: Sequence[str], points: Array) -> Bools:
    """Whether the distances between points are those of a body, for each of n sets (n, K, 3)."""
    fine = np.ones(len(points), bool)
    for upper, lower in pairwise(_CHAIN):
        if upper in names and lower in names:
            length = np.linalg.norm(points[:, names.index(upper)] - points[:, names.index(lower)], axis=-1)
            low, high = TRUNK_LENGTH_RANGE if upper == "Shoulder" else (0.0, MAX_BONE_LENGTH)
            fine &= ~((length < low) | (length > high))
    return fine
