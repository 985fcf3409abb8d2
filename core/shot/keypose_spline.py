"""The curve through the key poses: where every solver may start."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_banded
from scipy.spatial.transform import Rotation, RotationSpline

from ..body.motion import Motion
from ..numerics.arrays import Array
from .shot import KeyPoses


def spline(keys: KeyPoses, length: int) -> Motion:
    """Smooth motion through key poses, each degree of freedom through the keys that fix it; held beyond the ends.

    Parameters
    ----------
    keys : KeyPoses
    length : int
        Number of frames F of the shot.
    """
    P = keys.poses.rotations.shape[1]
    frames = np.arange(length)
    T = np.empty((length, 3))
    Q = np.empty((length, P, 3, 3))
    for axis in range(3):
        known = _known(keys.fixed[:, axis : axis + 1])
        T[:, axis] = _along(keys.frames[known], keys.poses.translations[known, axis], frames)
    for p in range(P):
        known = _known(keys.fixed[:, 3 + 3 * p : 6 + 3 * p])
        Q[:, p] = _turning(keys.frames[known], keys.poses.rotations[known, p], frames)
    return Motion(T, Q)


def _known(fixed: NDArray[np.bool_]) -> NDArray[np.intp]:
    """Key poses that fix all of these degrees of freedom; all of them if none does."""
    known = np.flatnonzero(fixed.all(axis=1))
    return known if len(known) else np.arange(len(fixed))


def _along(knots: NDArray[np.int64], values: Array, frames: NDArray[np.int64]) -> Array:
    if len(knots) == 1:
        return np.full(len(frames), values[0])
    return natural_spline(knots, values, np.clip(frames, knots[0], knots[-1]))


def natural_spline(knots: NDArray[np.int64], values: Array, places: NDArray[np.int64]) -> Array:
    """The natural cubic spline through values at two knots or more, at places between the first and the last.

    SciPy's own comes with packages that take longer to load than all key poses of a shot to pass through.
    """
    length, rise = np.diff(knots).astype(float), np.diff(values)
    slope, bend = rise / length, np.zeros(len(knots))  # bend: second derivatives, none at the ends
    if len(knots) > 2:
        inner = length[1:-1]
        band = np.stack([np.append(0.0, inner), 2 * (length[:-1] + length[1:]), np.append(inner, 0.0)])
        bend[1:-1] = solve_banded((1, 1), band, 6 * np.diff(slope), check_finite=False)
    k = np.clip(np.searchsorted(knots, places, side="right") - 1, 0, len(length) - 1)
    before, after, h = places - knots[k], knots[k + 1] - places, length[k]
    cubic = bend[k] * (after**3 / h - h * after) + bend[k + 1] * (before**3 / h - h * before)
    return np.asarray((values[k] * after + values[k + 1] * before) / h + cubic / 6)


def _turning(knots: NDArray[np.int64], values: Array, frames: NDArray[np.int64]) -> Array:
    if len(knots) == 1:
        return np.broadcast_to(values[0], (len(frames), 3, 3))
    clipped = np.clip(frames, knots[0], knots[-1])
    return np.asarray(RotationSpline(knots, Rotation.from_matrix(values))(clipped).as_matrix())
