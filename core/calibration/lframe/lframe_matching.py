"""Identifying the L-frame by all views together, once the cameras are known from the wand.

One view alone has only the positions of four things of the right colour, and a book in the place of a covered ball can
complete an L-frame there. In three dimensions, nothing else has its lengths.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from ...capture.calibration_objects import LFRAME_BALLS
from ...capture.capture import Capture, CaptureView, Markers
from ...numerics.arrays import Array, Ints
from ..solving.camera_rig import Rig
from ..solving.wand_triangulation import projected, rays, triangulated

_MAX_RESIDUAL = 0.006  # largest residual of a ball, relative to a picture's longer side: the cameras are not exact yet
_LENGTH_TOLERANCE = 0.04  # largest error of a length, metres
_BASES = ((0, 2, 3), (1, 2, 3), (0, 1, 3))
"""Sets of three balls not on a line, from which the L-frame's pose follows."""
_SAME_PLACE = 0.012  # metres within which two positions count as one
_MAX_PLACES, _MAX_POSES = 120, 4000  # numbers that are tried, which limit the time if the whole room has the colour
_MIN_BALLS = 8
"""Least number of an L-frame's balls over all views: fewer may match by chance."""
_SIZES = tuple(1.06**k for k in range(-14, 15))
"""Sizes of an L-frame, relative to its measures, that are tried where these contradict the wand: 0.44 to 2.3."""
_ROUNDS = 3  # of assigning the nearest balls and aligning the L-frame with them


def lframe_by_all_views(capture: Capture, rig: Rig) -> Capture:
    """Return the capture with the L-frame's balls of each view as identified by all views together.

    If a view shows the L-frame in another place than the others, it keeps the balls that it identified alone if these
    are an L-frame for its camera: the camera was moved then. If too few views agree, nothing is changed.

    Parameters
    ----------
    capture : Capture
        Views without `lframe_candidates` are not changed.
    rig : Rig
        The cameras in any world with the wand's scale.
    """
    seen = [_candidates(view) for view in capture.views]
    if not capture.has_lframe or sum(len(own) > 0 for own in seen) < 2:
        return capture
    balls = identified_together(rig, seen, capture.lframe_points)
    if balls is None:
        return capture
    views = []
    for v, (view, own) in enumerate(zip(capture.views, balls, strict=True)):
        if view.lframe_candidates is None or (not (own >= 0).any() and _is_lframe(rig, v, view, capture.lframe_points)):
            views.append(view)
        else:
            views.append(replace(view, lframe=_chosen(view.lframe_candidates, own)))
    return replace(capture, views=tuple(views))


def of_another_size(capture: Capture, rig: Rig) -> Capture | None:
    """Return the capture with the L-frame's balls of each view as `lframe_by_all_views` identifies them for an L-frame
    whose measures are all too long or too short by one factor, by the wand; None if there is none.
    """
    seen = [_candidates(view) for view in capture.views]
    if sum(len(own) > 0 for own in seen) < 2:
        return None
    found = [identified_together(rig, seen, size * capture.lframe_points) for size in _SIZES]
    balls = max((own for own in found if own is not None), key=lambda own: int((own >= 0).sum()), default=None)
    if balls is None:
        return None
    views = zip(capture.views, balls, strict=True)
    return replace(
        capture,
        views=tuple(
            view if view.lframe_candidates is None else replace(view, lframe=_chosen(view.lframe_candidates, own))
            for view, own in views
        ),
    )


def _candidates(view: CaptureView) -> Array:
    """Return the pixels of possible balls of the L-frame, shape (n, 2)."""
    return np.zeros((0, 2)) if view.lframe_candidates is None else view.lframe_candidates.points[0]


def _chosen(candidates: Markers, own: Ints) -> Markers:
    """Return the L-frame's balls among the candidates; NaN for index -1."""
    points = np.where((own >= 0)[:, None], candidates.points[0][own], np.nan)
    sigma = np.where(own >= 0, candidates.sigma[0][own], np.nan)
    kept = slice(None) if (own >= 0).any() else slice(0)
    return Markers(candidates.frames[kept], points[None][kept], sigma[None][kept])


def identified_together(rig: Rig, seen: Sequence[Array], measures: Array) -> Ints | None:
    """Return the index of each ball of the L-frame among the candidates of each view, shape (V, 4); -1 for none.

    Parameters
    ----------
    rig : Rig
    seen : sequence of ndarray, shape (n, 2)
        The candidates of each view, pixels.
    measures : ndarray, shape (4, 3)
        The L-frame's balls, metres.

    Returns
    -------
    ndarray or None
        None if too few of them form an L-frame.
    """
    points = np.full((len(rig), max(len(own) for own in seen), 2), np.nan)
    for v, own in enumerate(seen):
        points[v, : len(own)] = own
    poses = _poses(_distinct(rig, points, _meetings(rig, points)), measures)
    if not len(poses):
        return None
    balls = poses[int(np.argmax([_closeness(rig, points, pose).max(axis=2).sum() for pose in poses]))]
    chosen = np.full((len(rig), LFRAME_BALLS), -1)
    for _ in range(_ROUNDS):
        close = _closeness(rig, points, balls)
        chosen = np.where(close.max(axis=2) > 0, close.argmax(axis=2), -1)
        placed = triangulated(rig.centres_world, rays(rig, _at(points, chosen)))
        known = np.isfinite(placed).all(axis=1)
        if known.sum() < 3 or not {0, 1, 2} & set(np.flatnonzero(known)) or not known[3]:
            return None
        balls = _aligned(measures, measures[known], placed[known])
    return chosen if (chosen >= 0).sum() >= _MIN_BALLS else None


def _at(points: Array, chosen: Ints) -> Array:
    places = np.take_along_axis(points, np.maximum(chosen, 0)[..., None], axis=1)
    return np.where((chosen >= 0)[..., None], places, np.nan)


def _reach(rig: Rig) -> Array:
    """Return the largest residual of a ball in each view, shape (V,), pixels."""
    return np.asarray(_MAX_RESIDUAL * rig.sizes.max(axis=1))


def _meetings(rig: Rig, points: Array) -> Array:
    """Return the points where the rays of two candidates meet, for all pairs of views, shape (K, 3)."""
    directions, centres, reach = rays(rig, points), rig.centres_world, _reach(rig)
    found = []
    for v, w in combinations(range(len(rig)), 2):
        n = points.shape[1]
        both = np.stack(np.broadcast_arrays(directions[v][:, None], directions[w][None]))
        places = triangulated(centres[[v, w]], both.reshape(2, n * n, 3))
        off = [
            np.linalg.norm(projected(rig, c, places) - seen, axis=1) / reach[c]
            for c, seen in ((v, np.repeat(points[v], n, axis=0)), (w, np.tile(points[w], (n, 1))))
        ]
        found.append(places[np.nan_to_num(np.maximum(*off), nan=np.inf) < 1])
    return np.concatenate(found)


def _distinct(rig: Rig, points: Array, places: Array) -> Array:
    """Return the points that most views see, without duplicates: at a ball several pairs of views meet."""
    views = (_closeness(rig, points, places).max(axis=2) > 0).sum(axis=0)
    kept: list[int] = []
    for k in np.argsort(-views, kind="stable"):
        if len(kept) < _MAX_PLACES and all(np.linalg.norm(places[k] - places[other]) > _SAME_PLACE for other in kept):
            kept.append(int(k))
    return np.asarray(places[kept])


def _poses(places: Array, measures: Array) -> Array:
    """Return the L-frame's balls for every three points with the right distances, shape (P, 4, 3)."""
    apart = np.linalg.norm(places[:, None] - places, axis=-1)
    found = []
    for base in _BASES:
        a, b, c = measures[list(base)]
        fits_ab, fits_ac, fits_bc = (
            np.abs(apart - np.linalg.norm(x - y)) < _LENGTH_TOLERANCE for x, y in ((a, b), (a, c), (b, c))
        )
        for i, j in np.argwhere(fits_ab):
            for k in np.flatnonzero(fits_ac[i] & fits_bc[j]):
                found.append(_aligned(measures, measures[list(base)], places[[i, j, k]]))
                if len(found) >= _MAX_POSES:
                    return np.array(found)
    return np.array(found).reshape(-1, LFRAME_BALLS, 3)


def _aligned(whole: Array, measured: Array, placed: Array) -> Array:
    """Return the L-frame's balls, with some of them aligned to given points."""
    middle, there = measured.mean(axis=0), placed.mean(axis=0)
    R = Rotation.align_vectors(placed - there, measured - middle)[0].as_matrix()
    return (whole - middle) @ R.T + there


def _closeness(rig: Rig, points: Array, balls_world: Array) -> Array:
    """Return how near candidates are to balls in each view, shape (V, 4, n): 1 at their positions, 0 beyond the
    reach.
    """
    off = np.stack(
        [np.linalg.norm(projected(rig, v, balls_world)[:, None] - points[v], axis=-1) for v in range(len(rig))]
    )
    squared = (np.nan_to_num(off, nan=np.inf) / _reach(rig)[:, None, None]) ** 2
    return np.asarray(np.maximum(1 - squared, 0))


def _is_lframe(rig: Rig, v: int, view: CaptureView, measures: Array) -> bool:
    """Return whether the balls that a view identified alone form an L-frame, given its camera's intrinsics."""
    if not len(view.lframe) or not view.lframe.seen[0].all():
        return False
    K, distortions, seen = rig.matrix(v), rig.distortions[v], view.lframe.points[0]
    found, turn, shift = cv2.solvePnP(measures, seen, K, distortions, flags=cv2.SOLVEPNP_SQPNP)
    if not found:
        return False
    off = cv2.projectPoints(measures, turn, shift, K, distortions)[0][:, 0] - seen
    return bool(np.linalg.norm(off, axis=1).max() < _reach(rig)[v] / 2)
