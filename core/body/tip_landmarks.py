"""Landmarks at the tips of parts, which are joints with the names that detectors and files give them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..numerics.arrays import Array
from .body import Body
from .kinematics import landmark_positions
from .motion import Motion

MAX_TIP_DISTANCE = 0.01
"""A landmark belongs to the tip of a part if their distance in the rest pose is below this, metres."""


def tip_landmarks(body: Body) -> dict[int, str]:
    """Return the landmark at the tip of each part that has one, by part."""
    tails = np.array([part.tail_world for part in body.parts])
    found: dict[int, str] = {}
    for name, (part, point) in body.landmarks.items():
        place = body.parts[part].head_world + body.parts[part].R_world_rest @ point
        apart = np.linalg.norm(tails - place, axis=1)
        for tip in np.flatnonzero(apart < MAX_TIP_DISTANCE).tolist():
            found.setdefault(tip, name)
    return found


def tip_misfits(body: Body, names: Sequence[str], points_world: Array, poses: Motion) -> Array:
    """Root mean square distances of the parts' tips from the landmarks on which K poses were fitted, metres, (P,).

    For tips without a landmark, the average of the others is assumed.

    Parameters
    ----------
    body : Body
    names : sequence of str, length L
    points_world : ndarray, shape (K, L, 3)
        NaN where a landmark is not known.
    poses : Motion
        K poses.
    """
    at = {part: name for part, name in tip_landmarks(body).items() if name in names}
    shown = list(dict.fromkeys(at.values()))
    apart = landmark_positions(body, poses, shown) - points_world[:, [list(names).index(name) for name in shown]]
    squares = (apart**2).sum(axis=-1)
    known = np.isfinite(squares)
    mean = np.where(known, squares, 0.0).sum(axis=0) / np.maximum(known.sum(axis=0), 1)
    usual = float(mean[known.any(axis=0)].mean()) if known.any() else 0.0
    found = np.full(len(body), usual)
    for part, name in at.items():
        if known[:, shown.index(name)].any():
            found[part] = mean[shown.index(name)]
    return np.sqrt(found)
