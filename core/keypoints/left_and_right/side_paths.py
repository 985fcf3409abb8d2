"""Left and right of all views at once, before any motion is known: what views agree on, and what does not leap.

A detector that takes left for right in one view is contradicted by the others; one that does so in all views at the
same time makes both limbs leap to each other's places and back. Neither can be seen keypoint by keypoint, as the limbs
of a wrong view and a right one meet somewhere in space, too.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from ...numerics.arrays import Array, Bools, Ints
from ...numerics.likeliest_path import cheapest_path
from ..keypoint_rays import Keypoints
from ..triangulation import LEAP_DISTANCE, least_squares_points
from .facing import forward_directions
from .image_side_paths import INDEPENDENT_TIME, likeliest_image_sides
from .left_right import EXCHANGED_GROUPS, MAX_DISTANCE, sided_columns, swap_sides, with_exchanged

MIN_VIEWS = 3
"""With two views, the rays of a left and a right limb nearly meet wherever the limbs are equally high in the pictures,
so that exchanged limbs may be as steady as the others; then see `likeliest_image_sides`."""
ALL_PATTERNS_VIEWS = 4
"""Up to so many views, all combinations of exchanged views are considered; of more, only single ones and all, as the
others outvote them."""
FACING_COST = 0.1
"""Cost of hips or shoulders that face the other way than face or feet, where keypoints that all contradict one another
cost 1; half of it at a right angle."""
EXCHANGED_COST = 0.05
"""Cost of exchanging a group in all views."""
LEAP_COST = 0.5
"""Cost where all keypoints of a group leap from one frame to the next; fast limbs leap a little, too."""
CHANGE_COST = 0.1
"""Cost of each change of the views in which a group is exchanged."""


def likeliest_sides(keypoints: Keypoints, fps: float) -> NDArray[np.bool_]:
    """Return where left and right are probably exchanged, bool (V, F, L).

    For each group of landmarks that detectors exchange together, and three views or more, a shortest path over the
    frames chooses the views in which it is exchanged (Viterbi's algorithm). Its costs are the squared distances of the
    keypoints from the points that they meet in, those of these points from where they were on the frame before, both
    truncated, the angle between where hips or shoulders and where face and feet point (`FACING_COST`), and
    `EXCHANGED_COST`. With two views, the steadiest sides in each picture are exchanged on all frames or on none, by the
    same costs without leaps. A single view is left as it is.

    Parameters
    ----------
    keypoints : Keypoints
        In V views, on F frames.
    fps : float
    """
    V, F, L = keypoints.confidence.shape
    changed = np.zeros((V, F, L), bool)
    if V < 2:
        return changed
    within = changed.copy()
    if V < MIN_VIEWS:
        within = likeliest_image_sides(keypoints, fps)
        keypoints = with_exchanged(keypoints, swap_sides(keypoints), within)
    turned = swap_sides(keypoints)
    patterns, facing = np.array(list(_patterns(V))), forward_directions(keypoints)
    for group in EXCHANGED_GROUPS:
        columns = sided_columns(keypoints.names, group)
        if columns:
            own, other = keypoints.of_landmarks(columns), turned.of_landmarks(columns)
            costs, places = _costs_of_patterns(own, other, patterns, facing)
            if V < MIN_VIEWS:
                path = np.full(F, costs.sum(axis=1).argmin())
            else:
                path = _cheapest_patterns(costs / max(1.0, INDEPENDENT_TIME * fps), places)
            changed[..., columns] = patterns[path].T[..., None]
    return changed ^ within


def _patterns(views: int) -> Iterator[list[bool]]:
    """Generate the combinations of views whose sides may be exchanged, the fewest first."""
    counts = range(views + 1) if views <= ALL_PATTERNS_VIEWS else (0, 1, views)
    for count in counts:
        for exchanged in combinations(range(views), count):
            yield [v in exchanged for v in range(views)]


def _costs_of_patterns(
    own: Keypoints, turned: Keypoints, patterns: Bools, facing: tuple[Array, Array]
) -> tuple[Array, Array]:
    """Return the costs (S, F) of patterns and the points (S, F, K, 3) where rays meet, for one group of landmarks.

    Its keypoints are given as they were found, and with left and right exchanged; `facing` is as in
    `forward_directions`.
    """
    costs, places = [], []
    for pattern in patterns:
        sided = with_exchanged(own, turned, pattern[:, None, None])
        weight = sided.confidence * np.isfinite(sided.rays).all(axis=-1)
        points = least_squares_points(sided, weight)
        squares = np.sum(sided.residuals(points) ** 2, axis=-1)
        apart = _mean(np.minimum(squares / MAX_DISTANCE**2, 1.0), weight, axis=(0, 2))
        away = _turned_away(sided.names, points, *facing)
        costs.append(apart + FACING_COST * away + EXCHANGED_COST * pattern.mean())
        places.append(points)
    return np.array(costs), np.array(places)


def _mean(values: Array, weights: Array, axis: int | tuple[int, ...]) -> Array:
    """Weighted mean over the known values along axes; 0 where none is known."""
    weights = np.where(np.isfinite(values), weights, 0.0)
    total = weights.sum(axis=axis)
    return np.asarray((np.nan_to_num(values) * weights).sum(axis=axis) / np.where(total > 0, total, 1.0))


def _turned_away(names: Sequence[str], points: Array, forward: Array, trunk: Array) -> Array:
    """How far hips or shoulders, among points (F, K, 3), face away from each cue, from 0 to 1, in sum, (F,)."""
    pair = next(((f"L{n}", f"R{n}") for n in ("Hip", "Shoulder") if {f"L{n}", f"R{n}"} <= set(names)), None)
    if pair is None:
        return np.zeros(len(points))
    left, right = (points[:, names.index(name)] for name in pair)
    ahead = np.cross(left - right, trunk)
    length = np.linalg.norm(ahead, axis=-1)
    cosine = np.sum(forward * ahead, axis=-1) / np.where(length > 0, length, 1.0)
    return np.asarray(np.where(np.isfinite(cosine), (1 - cosine) / 2, 0.0).sum(axis=0))


def _cheapest_patterns(costs: Array, places: Array) -> Ints:
    """Return the state of each frame, (F,), on the path of least cost.

    Parameters
    ----------
    costs : ndarray, shape (S, F)
        Of being in a state.
    places : ndarray, shape (S, F, K, 3)
        Points in a state, metres; NaN where unknown. Leaps from one frame to the next have a cost.
    """
    changed = CHANGE_COST * (1 - np.eye(len(costs)))

    def change(f: int) -> Array:
        moved = np.sum((places[:, None, f - 1] - places[None, :, f]) ** 2, axis=-1)
        leap = np.minimum(moved / LEAP_DISTANCE**2, 1.0)
        return np.asarray(changed + LEAP_COST * _mean(leap, np.ones_like(leap), axis=-1))

    return cheapest_path(costs, change)
