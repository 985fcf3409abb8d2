"""The spline through the key poses, from which every solver may start."""

from __future__ import annotations

import numpy as np
import scipy  # its parts are loaded when they are used
from numpy.typing import NDArray
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
    clipped = np.clip(frames, knots[0], knots[-1])
    return np.asarray(scipy.interpolate.CubicSpline(knots, values, bc_type="natural")(clipped))


def _turning(knots: NDArray[np.int64], values: Array, frames: NDArray[np.int64]) -> Array:
    if len(knots) == 1:
        return np.broadcast_to(values[0], (len(frames), 3, 3))
    clipped = np.clip(frames, knots[0], knots[-1])
    return np.asarray(RotationSpline(knots, Rotation.from_matrix(values))(clipped).as_matrix())
