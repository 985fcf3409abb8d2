"""The spline through the key poses, from which every solver may start."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solveh_banded
from scipy.spatial.transform import Rotation, RotationSpline

from ..body.motion import Motion
from ..numerics.arrays import Array
from .shot import KeyPoses


def spline(keys: KeyPoses, length: int) -> Motion:
    """Return a smooth motion through key poses; each degree of freedom passes through the keys that fix it.

    Before the first and after the last key it is constant.

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
    """Return the indices of the key poses that fix all of these degrees of freedom; all indices if none does."""
    known = np.flatnonzero(fixed.all(axis=1))
    return known if len(known) else np.arange(len(fixed))


def _along(knots: NDArray[np.int64], values: Array, frames: NDArray[np.int64]) -> Array:
    if len(knots) == 1:
        return np.full(len(frames), values[0])
    return natural_spline(knots, values, np.clip(frames, knots[0], knots[-1]))


def natural_spline(knots: NDArray[np.int64], values: Array, at: NDArray[np.int64]) -> Array:
    """Interpolate values (K,) or (K, n) at two or more increasing knots by the cubic spline whose ends are straight.

    It is SciPy's natural `CubicSpline`, whose module takes a tenth of a second to load in every process.
    """
    width = np.diff(knots).astype(float)
    several = values.reshape(len(values), -1)
    slope = np.diff(several, axis=0) / width[:, None]
    bands = np.zeros((2, len(knots)))
    bands[0] = [1.0, *2 * (width[:-1] + width[1:]), 1.0]
    bands[1, 1:-2] = width[1:-1]
    none = np.zeros((1, several.shape[1]))
    curvature = solveh_banded(bands, np.concatenate([none, 6 * np.diff(slope, axis=0), none]), lower=True)
    left = np.clip(np.searchsorted(knots, at, side="right") - 1, 0, len(width) - 1)
    before, after, h = ((at - knots[left])[:, None], (knots[left + 1] - at)[:, None], width[left][:, None])
    bent = before * after * (curvature[left] * (h + after) + curvature[left + 1] * (h + before)) / (6 * h)
    found = several[left] * (after / h) + several[left + 1] * (before / h) - bent
    return np.asarray(found.reshape(len(at), *values.shape[1:]))


def _turning(knots: NDArray[np.int64], values: Array, frames: NDArray[np.int64]) -> Array:
    if len(knots) == 1:
        return np.broadcast_to(values[0], (len(frames), 3, 3))
    clipped = np.clip(frames, knots[0], knots[-1])
    return np.asarray(RotationSpline(knots, Rotation.from_matrix(values))(clipped).as_matrix())
