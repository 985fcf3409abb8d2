"""Values between known ones, as of curves at another frame rate: rotations by slerp, everything else linearly."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from .arrays import Array, Ints
from .rotations import continuous_signs


def sample_times(first: int, last: int, rate: float, wanted: float) -> Array:
    """Return the times at which to sample frames for another frame rate, in frames, from `first` up to `last`.

    Parameters
    ----------
    first, last : int
        Range of frames.
    rate : float
        Their frames per second.
    wanted : float
        Frames per second of the samples.
    """
    count = int(np.floor((last - first) * wanted / rate + 1e-6)) + 1
    return np.minimum(first + np.arange(count) * (rate / wanted), float(last))


def places_between(knots: Array | Ints, at: Array | Ints) -> tuple[Ints, Array]:
    """Return between which of K >= 2 increasing knots places lie: the index of the knot at or before each, up to K - 2,
    and how far on the way to the next knot it is, 0 to 1 between the first knot and the last.
    """
    left = np.clip(np.searchsorted(knots, at, side="right") - 1, 0, len(knots) - 2)
    return left, (at - knots[left]) / np.diff(knots)[left]


def gaps_filled(points: Array) -> Array:
    """Return points over time (F, 3), in which missing ones are interpolated linearly; NaN if none is known."""
    known = np.isfinite(points).all(axis=-1)
    if not known.any():
        return points
    frames = np.arange(len(points))
    return np.stack([np.interp(frames, frames[known], points[known, k]) for k in range(3)], axis=-1)


def slerped(wxyz: Array, frames: Array, times: Array) -> Array:
    """Unit quaternions (w, x, y, z) at times (K,), by slerp between those (F, 4) of frames (F,): shape (K, 4)."""
    if len(frames) == 1:
        return np.repeat(wxyz / np.linalg.norm(wxyz), len(times), axis=0)
    if np.array_equal(frames, times):
        found = continuous_signs(wxyz / np.linalg.norm(wxyz, axis=1, keepdims=True))
        return found if found[0] @ wxyz[0] >= 0 else -found
    xyzw = Slerp(frames, Rotation.from_quat(wxyz[:, [1, 2, 3, 0]]))(times).as_quat()
    found = continuous_signs(xyzw[:, [3, 0, 1, 2]])
    return found if found[0] @ wxyz[0] >= 0 else -found
