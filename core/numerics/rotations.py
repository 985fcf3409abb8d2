"""Rotations as the solvers need them: exponential, logarithm and their Jacobians, vectorised over leading axes.

Rotation vectors are radians. Conversions beyond these (Euler angles, quaternions, means) are scipy's `Rotation`.
References: G. S. Chirikjian, Stochastic Models, Information Theory, and Lie Groups, vol. 2, ch. 10.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from .arrays import Array, Bools

ROUNDING = 1e-3
"""Largest deviation of R^T R from the identity that rounding of a rotation matrix's digits can explain."""


def skew(v: Array) -> Array:
    """Return the matrix [v]x with [v]x w = v x w, shape (..., 3, 3)."""
    S = np.zeros((*v.shape, 3))
    S[..., 0, 1], S[..., 0, 2], S[..., 1, 2] = -v[..., 2], v[..., 1], -v[..., 0]
    S[..., 1, 0], S[..., 2, 0], S[..., 2, 1] = v[..., 2], -v[..., 1], v[..., 0]
    return S


def exp(v: Array) -> Array:
    """Return the rotation matrices (..., 3, 3) of rotation vectors (..., 3)."""
    return np.asarray(Rotation.from_rotvec(_listed(v, 1)).as_matrix().reshape(*v.shape, 3))


def log(R: Array) -> Array:
    """Return the rotation vectors (..., 3), of length at most pi, of rotation matrices (..., 3, 3)."""
    # To test that they are rotations would take as long as all else.
    return np.asarray(Rotation.from_matrix(_listed(R, 2), assume_valid=True).as_rotvec().reshape(R.shape[:-1]))


def orthonormal(R: Array) -> Array:
    """Return the rotation matrices (..., 3, 3) nearest to given ones: takes away the rounding of long products."""
    return np.asarray(Rotation.from_matrix(_listed(R, 2)).as_matrix().reshape(R.shape))


def are_orthonormal(R: Array) -> Bools:
    """Return which matrices (..., 3, 3) neither scale nor shear by more than `ROUNDING`, shape (...)."""
    return np.asarray(np.abs(np.swapaxes(R, -1, -2) @ R - np.eye(3)).max(axis=(-2, -1)) <= ROUNDING)


def are_rotations(R: Array) -> Bools:
    """Return which of them do not mirror either."""
    return are_orthonormal(R) & (np.linalg.det(R) > 0)


def shortest(a: Array, b: Array) -> Array:
    """Return the shortest turns that take unit vectors a to b, (..., 3), as matrices (..., 3, 3)."""
    axis = np.cross(a, b)
    sine = np.linalg.norm(axis, axis=-1, keepdims=True)
    angle = np.arctan2(sine, np.sum(a * b, axis=-1, keepdims=True))
    return exp(axis / np.maximum(sine, 1e-9) * angle)


def mean(R: Array, weight: Array) -> Array:
    """Return the rotations (P, 3, 3) nearest on average to rotation matrices (F, P, 3, 3) of weights (F, P).

    The square of their distance (Frobenius) is least, also where the matrices are so far apart that their sum mirrors.
    Without any weight it is no turn.
    """
    left, _, right = np.linalg.svd(np.einsum("fp,fpab->pab", weight, R))
    left[:, :, 2] *= np.linalg.det(left @ right)[:, None]
    return np.asarray(left @ right)


def _listed(values: Array, axes: int) -> Array:
    """Return values with all but the last `axes` axes joined, in writable memory, as SciPy refuses any other."""
    return np.require(values.reshape(-1, *values.shape[-axes:]), requirements="W")


def right_jacobian(v: Array) -> Array:
    """Jr with exp(v + d) = exp(v) exp(Jr(v) d) to first order, shape (..., 3, 3)."""
    angle2 = np.sum(v * v, axis=-1)[..., None, None]
    S = skew(v)
    small = angle2 < 1e-6
    safe = np.where(small, 1.0, angle2)
    angle = np.sqrt(safe)
    a = np.where(small, 0.5 - angle2 / 24, (1 - np.cos(angle)) / safe)
    b = np.where(small, 1 / 6 - angle2 / 120, (angle - np.sin(angle)) / (safe * angle))
    return np.asarray(np.eye(3) - a * S + b * (S @ S))


def right_jacobian_inverse(v: Array) -> Array:
    """Inverse of `right_jacobian`: log(exp(v) exp(d)) = v + Jr^-1(v) d to first order, shape (..., 3, 3)."""
    angle2 = np.sum(v * v, axis=-1)[..., None, None]
    S = skew(v)
    small = angle2 < 1e-6
    safe = np.where(small, 1.0, angle2)
    half = np.sqrt(safe) / 2
    c = np.where(small, 1 / 12 + angle2 / 720, (1 - half / np.tan(half)) / safe)
    return np.asarray(np.eye(3) + 0.5 * S + c * (S @ S))


def left_jacobian_inverse(v: Array) -> Array:
    """log(exp(d) exp(v)) = v + Jl^-1(v) d to first order, shape (..., 3, 3)."""
    return np.swapaxes(right_jacobian_inverse(v), -1, -2)


def continuous_signs(quaternions: Array) -> Array:
    """Return the same rotations (F, ..., 4) with signs that do not jump along time: q and -q are one rotation."""
    jumps = np.sum(quaternions[1:] * quaternions[:-1], axis=-1, keepdims=True) < 0
    signs = np.cumprod(np.where(jumps, -1.0, 1.0), axis=0)
    return np.concatenate([quaternions[:1], quaternions[1:] * signs])
