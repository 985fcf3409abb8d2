"""Turns of a camera whose lens may zoom: matrices that lead from its axes on one picture to those on another.

A lens that zooms by z shows what a calibrated one would, were the two axes of the picture z times as long: such a
matrix is diag(z, z, 1) R, with a rotation R; it is R where nothing zooms.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation, Slerp

from ..numerics.arrays import Array, Ints

_ROUNDING = 1e-9


def zooming(zooms: ArrayLike) -> Array:
    """Return the matrices diag(z, z, 1), shape (N, 3, 3), of zooms (N,)."""
    z = np.asarray(zooms, float)
    return np.stack([z, z, np.ones_like(z)], axis=-1)[..., None] * np.eye(3)


def split(turns: Array) -> tuple[Array, Array]:
    """Return the rotations (N, 3, 3) and the zooms (N,) of turns (N, 3, 3)."""
    zooms = np.linalg.norm(turns[:, 0], axis=-1)
    zooms = np.where(np.abs(zooms - 1) < _ROUNDING, 1.0, zooms)
    return zooming(1 / zooms) @ turns, zooms


def undone_zoom(turn: Array) -> Array:
    """Return the matrix (3, 3) of a turn to axes that do not zoom, R diag(1 / z, 1 / z, 1), without its rotation."""
    return zooming(np.linalg.norm(turn[:, 0]))


def since(turns: Array, others: Array) -> Array:
    """Return turns (N, 3, 3) as from the axes after others, one or N, on instead of from those before."""
    (R, zooms), (other_R, other_zooms) = split(turns), split(others)
    return np.asarray(zooming(zooms / other_zooms) @ R @ np.swapaxes(other_R, 1, 2))


def interpolated(frames: Ints, turns: Array, wanted: Ints) -> Array:
    """Return the turns (F, 3, 3) on the wanted frames (F,) between those that are given, (K, 3, 3) on frames (K,)."""
    if len(turns) == 1:
        return np.repeat(turns, len(wanted), axis=0)
    R, zooms = split(turns)
    between = np.exp(np.interp(wanted, frames, np.log(zooms)))
    return np.asarray(zooming(between) @ Slerp(frames, Rotation.from_matrix(R))(wanted).as_matrix())
