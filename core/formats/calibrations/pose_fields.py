"""Camera poses in all the shapes that occur in calibration files."""

from __future__ import annotations

from typing import Any

import numpy as np

from ...errors import CalibrationError
from ...numerics import rotations
from ...numerics.arrays import Array

MAX_ANGLE = 4 * np.pi
"""Longest Rodrigues vector that is accepted, radians: half a turn is enough for any rotation."""
_VECTORS = ((3,), (3, 1), (1, 3))
_MATRICES = ((3, 3), (9,))
_ACCEPTED_ROTATIONS = "a Rodrigues vector (3, 3x1 or 1x3 numbers, radians) or a 3x3 matrix"


def camera_poses(rotation: Any, translation: Any, where: str) -> tuple[Array, Array]:
    """Return the world to camera rotations (N, 3, 3) and translations (N, 3) of a camera.

    Parameters
    ----------
    rotation : array-like
        For a fixed camera, a Rodrigues vector of shape (3,), (3, 1) or (1, 3), a matrix of shape (3, 3), or its nine
        numbers row by row. For a moving camera, one of shape (3,), (3, 1), (1, 3) or (3, 3) per frame.
    translation : array-like
        For a fixed camera, three numbers in any shape; for a moving camera, three per frame.
    where : str
        File and camera, for error messages.

    Raises
    ------
    CalibrationError
        The shapes are different, a number is not finite, or a matrix is not a rotation.

    Notes
    -----
    Three frames of Rodrigues vectors have the same shape as one matrix; the shape of the translation decides.
    """
    R, t = _finite(rotation, "rotation", where), _finite(translation, "translation", where)
    if t.size == 3:
        return _matrices(R[None], where), t.reshape(1, 3)
    if t.ndim not in (2, 3) or t[0].size != 3:
        raise CalibrationError(f"'translation' has shape {t.shape}, not three numbers (for each frame)", where=where)
    if len(R) != len(t):
        raise CalibrationError(f"{len(R)} rotations but {len(t)} translations", where=where)
    return _matrices(R, where), t.reshape(-1, 3)


def _finite(values: Any, key: str, where: str) -> Array:
    try:
        numbers = np.asarray(values, dtype=float)
    except (TypeError, ValueError) as error:
        raise CalibrationError(f"'{key}' must be numbers", where=where) from error
    if not np.isfinite(numbers).all():
        raise CalibrationError(f"'{key}' holds a value that is not a finite number", where=where)
    return np.atleast_1d(numbers)


def _matrices(values: Array, where: str) -> Array:
    """Return the rotation matrices (N, 3, 3) of N Rodrigues vectors or matrices."""
    shape = values.shape[1:]
    if shape in _VECTORS:
        if (longest := np.linalg.norm(values.reshape(-1, 3), axis=1).max()) > MAX_ANGLE:
            what = f"'rotation' is a Rodrigues vector of {longest:.0f} radians, which are several turns"
            raise CalibrationError(what, where=where, todo="if these are degrees, give radians")
        return rotations.exp(values.reshape(-1, 3))
    if shape not in _MATRICES:
        todo = f"give {_ACCEPTED_ROTATIONS}"
        if shape == (4,):
            raise CalibrationError("'rotation' has 4 numbers: quaternions are not read", where=where, todo=todo)
        raise CalibrationError(f"'rotation' has shape {shape}, not 3, 3x1, 1x3 or 3x3", where=where, todo=todo)
    R = values.reshape(-1, 3, 3)
    if not rotations.are_orthonormal(R).all():
        todo = f"give {_ACCEPTED_ROTATIONS}; a scale or a translation does not belong in it"
        raise CalibrationError("the 3x3 matrix of 'rotation' is not a rotation", where=where, todo=todo)
    if (np.linalg.det(R) < 0).any():
        todo = "axes must be right-handed: x right, y down, z forward in the camera"
        raise CalibrationError("the 3x3 matrix of 'rotation' mirrors", where=where, todo=todo)
    return rotations.orthonormal(R)
