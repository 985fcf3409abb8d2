"""Time offsets between the cameras' videos from the wand's path, before anything is known about the cameras.

Two videos of one moving wand have an epipolar geometry only if their frames match. For every offset, a fundamental
matrix is estimated linearly (R. Hartley, In Defense of the Eight-Point Algorithm, PAMI 1997), and the offset with the
smallest residual is used; tracks are interpolated between frames. The bundle adjustment refines the offsets.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from ...capture.capture import Markers
from ...numerics.arrays import Array
from .camera_rig import DRIFT, OFFSET, Rig
from .pairwise import sampson
from .wand_tracks import sampled

MIN_OVERLAP = 0.35
"""Least overlap of two videos, as a fraction of the shorter track."""
MIN_FRAMES = 30
"""Least number of frames on which both videos must show the wand at an offset that is tried."""
_SAMPLED_FRAMES = 250
"""Number of frames used in the first evaluation of an offset."""
_CANDIDATES = 8  # offsets that are refined between frames
_FRACTIONS = np.linspace(-1, 1, 17)  # shifts that are tried around the best whole number, frames
_ROUNDS = 3  # of this refinement
_CLOSE_DISTANCE = 3.0
"""Median distance from epipolar lines, pixels, below which the other order of the wand's ends is not tried."""


@dataclass(frozen=True, eq=False)
class Clocks:
    """The clocks of a take's videos.

    Attributes
    ----------
    names : tuple of str, length C
    offset, drift : ndarray, shape (C,)
        Frame s of the take is frame rate (1 + drift) s + offset of a camera's video.
    offset_sigma, drift_sigma : ndarray, shape (C,)
        Standard deviations; 0 for values that were not solved for.
    """

    names: tuple[str, ...]
    offset: Array
    drift: Array
    offset_sigma: Array
    drift_sigma: Array

    @classmethod
    def of(cls, rig: Rig, sigma: Array) -> Clocks:
        """Return the clocks of a rig whose unknowns have the standard deviations sigma, shape (C, 13)."""
        return cls(rig.names, rig.offset, rig.drift, sigma[:, OFFSET], sigma[:, DRIFT])

    @property
    def lines(self) -> list[str]:
        """One line per camera, with the offset as in a shot file's [[view]]."""
        return [
            f"{name}: offset = {offset:.4f}"
            + (f" (standard deviation {spread:.4f} frames)" if spread else "")
            + (f", drift {drift:.2e} (standard deviation {drift_spread:.1e})" if drift_spread else "")
            for name, offset, spread, drift, drift_spread in zip(
                self.names, self.offset, self.offset_sigma, self.drift, self.drift_sigma, strict=True
            )
        ]


@dataclass(frozen=True)
class Lag:
    """The lag between two videos.

    Attributes
    ----------
    lag : float
        Frames of the second: frame f of the first is frame ratio f + lag of the second.
    distance : float
        Median distance of the balls from their epipolar lines with this lag, pixels.
    shared : int
        Number of frames on which both videos show the wand.
    """

    lag: float
    distance: float
    shared: int


def find_lag(one: Markers, other: Markers, ratio: float = 1.0) -> Lag | None:
    """Return the lag of the second video behind the first; None if they do not see the wand together for long enough.

    Parameters
    ----------
    one, other : Markers
        A waved wand in both videos, see `wand_tracks.cleaned`.
    ratio : float
        Frames of the second video per frame of the first.
    """
    straight = _find_lag(one, other, ratio)
    if straight is not None and straight.distance < _CLOSE_DISTANCE:
        return straight
    turned = Markers(other.frames, other.points[:, ::-1], other.sigma[:, ::-1])
    both = [lag for lag in (straight, _find_lag(one, turned, ratio)) if lag is not None]
    return min(both, key=lambda lag: lag.distance) if both else None


def _find_lag(one: Markers, other: Markers, ratio: float) -> Lag | None:
    """Return the same as `find_lag`, with the ends of the wand in the same order."""
    if not len(one) or not len(other):
        return None
    start, stop = int(np.ceil(other.frames[0] / ratio)), int(other.frames[-1] / ratio)
    grid = np.arange(start, stop + 1)
    a = sampled(one, np.arange(one.frames[0], one.frames[-1] + 1.0))[0]
    b = sampled(other, ratio * grid)[0]
    scores = _algebraic(a, b)
    if not scores:
        return None
    shift = start - int(one.frames[0])
    best = sorted(scores, key=lambda lag: scores[lag])[:_CANDIDATES]
    tried = [found for lag in best if (found := _distance(one, other, ratio, ratio * (lag + shift)))]
    if not tried:
        return None
    whole = min(tried, key=lambda found: found.distance)
    near = [found for f in _FRACTIONS if (found := _distance(one, other, ratio, whole.lag + f))]
    return min(near, key=lambda found: found.distance)


def _algebraic(a: Array, b: Array) -> dict[int, float]:
    """Return the smallest eigenvalue of the eight-point equations for every shift of b (G, 2, 2) against a (F, 2,
    2).
    """
    seen_a, seen_b = (np.isfinite(x).all(axis=(1, 2)) for x in (a, b))
    least = max(MIN_FRAMES, MIN_OVERLAP * min(seen_a.sum(), seen_b.sum()))
    x, y = _normalised(a), _normalised(b)
    scores = {}
    for lag in range(-len(a) + 1, len(b)):
        first, last = max(0, -lag), min(len(a), len(b) - lag)
        both = seen_a[first:last] & seen_b[first + lag : last + lag]
        shared = np.flatnonzero(both)
        if len(shared) >= least:
            some = first + shared[np.linspace(0, len(shared) - 1, min(_SAMPLED_FRAMES, len(shared))).astype(int)]
            rows = _equations(x[some].reshape(-1, 3), y[some + lag].reshape(-1, 3))
            scores[lag] = float(np.linalg.eigvalsh(rows.T @ rows)[0] / (len(rows) - 8))
    return scores


def _normalised(points: Array) -> Array:
    """Return homogeneous points (..., 3), normalised to mean 0 and spread 1."""
    flat = points[np.isfinite(points).all(axis=-1)]
    spread = flat.std() if len(flat) else 1.0
    x = (points - flat.mean(axis=0)) / max(spread, 1e-9) if len(flat) else points
    return np.concatenate([x, np.ones((*x.shape[:-1], 1))], axis=-1)


def _equations(x: Array, y: Array) -> Array:
    """Return the rows of the eight-point equations y^T F x = 0, shape (n, 9)."""
    return (y[:, :, None] * x[:, None, :]).reshape(-1, 9)


def _distance(one: Markers, other: Markers, ratio: float, lag: float) -> Lag | None:
    """Evaluate a lag with a robustly fitted fundamental matrix."""
    points, _ = sampled(other, ratio * one.frames + lag)
    both = np.isfinite(points).all(axis=(1, 2)) & one.seen.all(axis=1)
    if both.sum() < MIN_FRAMES:
        return None
    a, b = one.points[both].reshape(-1, 2), points[both].reshape(-1, 2)
    x, y = _normalised(a), _normalised(b)
    scale = a.std(), b.std()
    weight, distance = np.ones(len(x)), np.zeros(len(x))
    for _ in range(_ROUNDS):
        F = np.linalg.eigh((rows := _equations(x, y) * weight[:, None]).T @ rows)[1][:, 0].reshape(3, 3)
        U, s, Vt = np.linalg.svd(F)
        F = U @ np.diag([s[0], s[1], 0]) @ Vt
        distance = sampson(F, x[:, :2], y[:, :2]) * np.mean(scale)
        weight = 1 / (1 + (distance / (1.5 * np.median(distance) + 1e-12)) ** 2)
    return Lag(float(lag), float(np.median(distance)), int(both.sum()))


def find_offsets(wands: Sequence[Markers], rate: Array, given: Sequence[float | None]) -> tuple[Array, list[int]]:
    """Find the offsets of all videos, along the pairs with the best lags.

    Parameters
    ----------
    wands : sequence of Markers
        A waved wand in all videos, see `wand_tracks.cleaned`.
    rate : ndarray, shape (V,)
        Frames of each video per frame of the capture.
    given : sequence of float or None
        Known offsets. If none is known, the first video's is 0.

    Returns
    -------
    offsets : ndarray, shape (V,)
        NaN for videos that share too few frames with the others.
    found : list of int
        The videos whose offsets were estimated.
    """
    offsets = np.array([np.nan if o is None else o for o in given], float)
    if np.isnan(offsets).all():
        offsets[0] = 0.0
    found = [int(v) for v in np.flatnonzero(np.isnan(offsets))]
    if not found:
        return offsets, found
    lags: dict[tuple[int, int], Lag] = {}
    for i, j in combinations(range(len(wands)), 2):
        if (i in found or j in found) and (lag := find_lag(wands[i], wands[j], rate[j] / rate[i])) is not None:
            lags[i, j] = lag
    while True:
        open_pairs = {pair: lag for pair, lag in lags.items() if np.isnan(offsets[list(pair)]).sum() == 1}
        if not open_pairs:
            return offsets, found
        (i, j), lag = min(open_pairs.items(), key=lambda item: item[1].distance / np.sqrt(item[1].shared))
        ratio = rate[j] / rate[i]
        if np.isnan(offsets[j]):
            offsets[j] = ratio * offsets[i] + lag.lag
        else:
            offsets[i] = (offsets[j] - lag.lag) / ratio
