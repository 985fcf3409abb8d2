"""Splines through rotations: smooth turns whose angular rate and acceleration are continuous.

Between two knots the rotation vector from the first of them is a cubic polynomial of time. The angular rates at the
inner knots follow from equal accelerations on both sides, which are linear but for a small term: it is computed from
the rates before, and the equations are solved again. At the ends the rate is that of an even turn. It is SciPy's
`RotationSpline` (N. Mayorov, Smooth Attitude Interpolation, 2019), to the last bit, but for many rotations at
once and without SciPy's polynomials, whose module takes a tenth of a second to load in every process.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_banded
from scipy.spatial.transform import Rotation

from ..numerics import rotations
from ..numerics.arrays import Array

MAX_ITERATIONS = 10
TOLERANCE = 1e-9
"""Change of the rates, relative to one more than them, at which iterations end."""
_SMALL = 1e-4
"""Angle up to which series are used."""


def rotation_spline(knots: NDArray[np.int64], values: Array, at: NDArray[np.int64]) -> Array:
    """Interpolate rotations of P parts.

    Parameters
    ----------
    knots : ndarray of int, shape (K,)
        Two or more, increasing.
    values : ndarray, shape (K, P, 3, 3)
        Rotation matrices.
    at : ndarray of int, shape (N,)
        Between the first knot and the last.

    Returns
    -------
    ndarray, shape (N, P, 3, 3)
    """
    K, P = values.shape[:2]
    known = Rotation.from_matrix(values.reshape(-1, 3, 3))
    turns = (known[:-P].inv() * known[P:]).as_rotvec().reshape(K - 1, P, 3)
    width = np.diff(knots.astype(float))[:, None, None]
    start = end = turns / width
    if K > 2:
        start, end = _rates(width, turns)
    cubic = (-2 * turns + width * start + width * end) / width**3
    square = (3 * turns - 2 * width * start - width * end) / width**2
    left = np.clip(np.searchsorted(knots, at, side="right") - 1, 0, K - 2)
    t = (at - knots[left]).astype(float)[:, None, None]
    turned = start[left] * t + square[left] * (t * t) + cubic[left] * (t * t * t)
    found = known[(P * left[:, None] + np.arange(P)).ravel()] * Rotation.from_rotvec(turned.reshape(-1, 3))
    return np.asarray(found.as_matrix().reshape(len(at), P, 3, 3))


def _rates(width: Array, turns: Array) -> tuple[Array, Array]:
    """Angular rates at the beginning of each of K - 1 turns of these widths, and the rates of the rotation vectors at
    its end, (K - 1, P, 3).
    """
    to_turns, to_rates = _rate_matrices(turns)
    first = turns[:1] / width[:1]
    across = width[1:-1, ..., None]
    own = np.asarray(4 * (1 / width[:-1, 0, 0] + 1 / width[1:, 0, 0]), float)
    before, after = 2 * to_rates[1:-1] / across, 2 * to_turns[1:-1] / across
    even = 6 * (turns[:-1] * width[:-1] ** -2 + turns[1:] * width[1:] ** -2)
    rates = turns / width
    for p in range(turns.shape[1]):
        even[0, p] -= 2 / width[0, 0, 0] * to_rates[0, p].dot(rates[0, p])
        even[-1, p] -= 2 / width[-1, 0, 0] * to_turns[-1, p].dot(rates[-1, p])
        bands = _bands(before[:, p], own, after[:, p])
        for _ in range(MAX_ITERATIONS):
            bent = _quadratic_acceleration(turns[:-1, p], _times(to_turns[:, p], rates[:, p])[:-1])
            found = solve_banded((5, 5), bands, (even[:, p] - bent).ravel(), check_finite=False).reshape(-1, 3)
            change = np.abs(found - rates[:-1, p])
            rates[:-1, p] = found
            if (change < TOLERANCE * (1 + np.abs(found))).all():
                break
    return np.concatenate([first, rates[:-1]]), _times(to_turns, rates)


def _rate_matrices(v: Array) -> tuple[Array, Array]:
    """Matrices from angular rates to those of rotation vectors (..., 3), and back, (..., 3, 3)."""
    n = np.linalg.norm(v, axis=-1)
    small = n <= _SMALL
    safe = np.where(small, 1.0, n)
    a = np.where(small, 1 / 12 + 1 / 720 * n**2, (1 - 0.5 * safe / np.tan(0.5 * safe)) / safe**2)[..., None, None]
    b = np.where(small, 0.5 - n**2 / 24, (1 - np.cos(safe)) / safe**2)[..., None, None]
    c = np.where(small, 1 / 6 - n**2 / 120, (safe - np.sin(safe)) / safe**3)[..., None, None]
    across = rotations.skew(v)
    squared = across @ across
    return np.eye(3) + 0.5 * across + a * squared, np.eye(3) - b * across + c * squared


def _bands(below: Array, own: Array, above: Array) -> Array:
    """Storage for `scipy.linalg.solve_banded`, (11, 3 n), of a matrix of n x n blocks: multiples `own` (n,) of the unit
    matrix on the diagonal, and blocks (n - 1, 3, 3) below and above it.
    """
    n = len(own)
    out = np.zeros((11, 3 * n))
    out[5] = np.repeat(own, 3)
    for i in range(3):
        for j in range(3):
            out[5 + 3 + i - j, j : 3 * (n - 1) : 3] = below[:, i, j]
            out[5 - 3 + i - j, 3 + j :: 3] = above[:, i, j]
    return out


def _quadratic_acceleration(v: Array, rate: Array) -> Array:
    """The part of the angular acceleration that is quadratic in the rates (n, 3) of rotation vectors (n, 3)."""
    n = np.linalg.norm(v, axis=1, keepdims=True)
    small = n <= _SMALL
    safe = np.where(small, 1.0, n)
    once = np.cross(v, rate)
    twice, across = np.cross(v, once), np.cross(rate, once)
    sin, cos = np.sin(safe), np.cos(safe)
    a = np.where(small, 1 / 12 - n**2 / 180, (-safe * sin - 2 * (cos - 1)) / safe**4)
    b = np.where(small, -1 / 60 + n**2 / 1260, (-2 * safe + 3 * sin - safe * cos) / safe**5)
    c = np.where(small, 1 / 6 - n**2 / 120, (safe - sin) / safe**3)
    along = np.sum(v * rate, axis=1, keepdims=True)
    return np.asarray(along * (a * once + b * twice) + c * across)


def _times(matrices: Array, vectors: Array) -> Array:
    return np.asarray(np.einsum("...ij,...j->...i", matrices, vectors))
