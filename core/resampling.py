"""Curves at another frame rate: rotations by slerp, all else linearly."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation, Slerp

Array = NDArray[np.float64]


def sample_times(first: int, last: int, rate: float, wanted: float) -> Array:
    """Frames, whole or not, at which a rate of `wanted` per second shows frames `first` to `last` of a rate of `rate`.

    The first is the first; the last is at most the last.
    """
    count = int(np.floor((last - first) * wanted / rate + 1e-6)) + 1
    return np.minimum(first + np.arange(count) * (rate / wanted), float(last))


def continuous_signs(quaternions: Array) -> Array:
    """The same rotations (F, 4) with signs that do not jump along time: q and -q are one rotation."""
    turned = np.sum(quaternions[1:] * quaternions[:-1], axis=1) < 0
    signs = np.cumprod(np.concatenate([[1.0], np.where(turned, -1.0, 1.0)]))
    return quaternions * signs[:, None]


def slerped(wxyz: Array, frames: Array, times: Array) -> Array:
    """Unit quaternions (w, x, y, z) at times (K,), between those (F, 4) of frames (F,): each way at a constant rate."""
    if len(frames) == 1:
        return np.repeat(wxyz / np.linalg.norm(wxyz), len(times), axis=0)
    xyzw = Slerp(frames, Rotation.from_quat(wxyz[:, [1, 2, 3, 0]]))(times).as_quat()
    found = continuous_signs(xyzw[:, [3, 0, 1, 2]])
    return found if found[0] @ wxyz[0] >= 0 else -found
