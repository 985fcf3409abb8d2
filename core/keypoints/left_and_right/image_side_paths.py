"""Left and right in a single picture: limbs that are exchanged leap to each other's places, and back."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ...numerics.arrays import Array, Ints
from ...numerics.likeliest_path import steadiest_path
from ..keypoint_rays import Keypoints
from .left_right import EXCHANGED_GROUPS, sided_columns, swap_sides

TRUNK_LENGTH = 0.5
"""Usual distance from the middle of the hips to that of the shoulders, metres."""
LEAP_DISTANCE = 0.1
"""Change of velocity, per frame, from which on a point leaps, metres."""
LEAP_COST = 0.5
"""Cost where all keypoints of a group leap, by the change of their velocity."""
EXCHANGED_COST = 0.1
"""Cost of exchanging a group, for as long as a detector's errors last (`INDEPENDENT_TIME`)."""
CHANGE_COST = 0.2
"""Cost of each change."""
INDEPENDENT_TIME = 0.1
"""Time after which a detector errs anew, seconds: what is wrong for so long counts once, however many frames it is."""


def likeliest_image_sides(keypoints: Keypoints, fps: float) -> NDArray[np.bool_]:
    """Return where left and right leap to each other's places for a while, bool (V, F, L), in each view by itself.

    A detector that exchanges them in one of two views, or in the only one, is not contradicted by others. For each view
    and group of landmarks, the steadiest path over the frames decides.

    Parameters
    ----------
    keypoints : Keypoints
        In V views, on F frames.
    fps : float
    """
    changed = np.zeros(keypoints.confidence.shape, bool)
    turned, once = swap_sides(keypoints), max(1.0, INDEPENDENT_TIME * fps)
    for v in range(len(changed)):
        scale = TRUNK_LENGTH / _trunk_extent(keypoints, v)
        for group in EXCHANGED_GROUPS:
            columns = sided_columns(keypoints.names, group)
            if columns and np.isfinite(scale):
                places = scale * np.array([one.rays[v][:, columns] for one in (keypoints, turned)])
                changed[v][:, columns] = _steadiest(places, EXCHANGED_COST / once)[:, None] == 1
    return changed


def _trunk_extent(keypoints: Keypoints, view: int) -> float:
    """Length of the trunk in a view as far as it is not foreshortened, in normalized image coordinates; NaN if it is
    not found.
    """
    middles = []
    for joint in ("Shoulder", "Hip"):
        if not {f"L{joint}", f"R{joint}"} <= set(keypoints.names):
            return float("nan")
        middles.append(keypoints.rays[view][:, [keypoints.names.index(side + joint) for side in "LR"]].mean(axis=1))
    extent = np.linalg.norm(middles[0] - middles[1], axis=-1)
    extent = extent[np.isfinite(extent) & (extent > 0)]
    return float(np.quantile(extent, 0.8)) if len(extent) else float("nan")


def _steadiest(places: Array, exchanged_cost: float) -> Ints:
    """Return which of two states each frame has, (F,), so that points (2, F, K, 2) change their velocities least."""
    F = places.shape[1]
    if F < 2:
        return np.zeros(F, np.intp)
    cost, change = np.array([0.0, exchanged_cost]), CHANGE_COST * (1 - np.eye(2))
    bends = places[:, None, None, :-2] - 2 * places[None, :, None, 1:-1] + places[None, None, :, 2:]
    steps = LEAP_COST * _leaping(bends) + (cost + change)[None, :, :, None]
    return steadiest_path(cost[:, None] + cost + change, lambda f: np.asarray(steps[..., f - 2]), F)


def _leaping(bends: Array) -> Array:
    """Mean over K points of squared changes of velocity (..., K, 2), truncated at a leap; 0 if none is known."""
    squares = np.minimum(np.sum(bends**2, axis=-1) / LEAP_DISTANCE**2, 1.0)
    known = np.isfinite(squares)
    return np.asarray(np.where(known, squares, 0.0).sum(axis=-1) / np.maximum(known.sum(axis=-1), 1))
