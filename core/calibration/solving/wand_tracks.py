"""The wand's tracks in the pictures: removing outliers, and sampling on common frames."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from ...capture.capture import Markers
from ...numerics.arrays import Array, Ints

_REACH = 4
"""Number of frames on either side from which a ball's position is predicted."""
_SMOOTH_SHARE = 0.35
"""Largest ratio of a ball's distance from the middle of its neighbours to its movement, for a waved wand."""
_OUTLIER_RATIO = 6.0
"""Multiple of the usual distance from its predicted position from which a ball is an outlier."""
_SWAP_RATIO = 0.3
"""Ends are swapped if their distances from each other's predicted positions are below this fraction of their own."""
_ACCEPTED_DISTANCE = 3.0
"""Distance from its predicted position that is always accepted, pixels."""
_USUAL_QUANTILE = 0.3
"""Quantile used for the usual distance, which is robust against many wrong balls."""
_MIN_FRAMES = 10  # least number of frames from which a path is judged
_MAX_GAP = 4
"""Longest gap in a track over which it is interpolated, frames."""


@dataclass(frozen=True, eq=False)
class Tracks:
    """The wand in all views on common frames.

    Attributes
    ----------
    frames : ndarray of int, shape (n,)
        Frames of the capture, increasing.
    points : ndarray, shape (V, n, 2, 2)
        View, frame, ball; pixels, NaN where not seen.
    sigma : ndarray, shape (V, n, 2)
        Pixels.
    """

    frames: Ints
    points: Array
    sigma: Array

    @property
    def seen(self) -> NDArray[np.bool_]:
        """Shape (V, n, 2)."""
        return np.asarray(np.isfinite(self.points).all(axis=-1))

    def take(self, frames: NDArray[Any]) -> Tracks:
        """Return the tracks on some of the frames."""
        return Tracks(self.frames[frames], self.points[:, frames], self.sigma[:, frames])

    def views(self, chosen: Sequence[int]) -> Tracks:
        """Return the tracks of some of the views."""
        return replace(self, points=self.points[list(chosen)], sigma=self.sigma[list(chosen)])


def is_waved(markers: Markers) -> bool:
    """Return whether the balls move smoothly enough to be interpolated between frames."""
    if not len(markers):
        return False
    points = _dense(markers)[0]
    bend = np.linalg.norm(points[1:-1] - (points[2:] + points[:-2]) / 2, axis=-1)
    move = np.linalg.norm(points[2:] - points[:-2], axis=-1) / 2
    known = np.isfinite(bend)
    if known.sum() < _MIN_FRAMES:
        return False
    # A low quantile: of three balls in a row, one is often wrong.
    usual_bend, usual_move = np.quantile(bend[known], _USUAL_QUANTILE), np.quantile(move[known], _USUAL_QUANTILE)
    return bool(usual_bend < max(_SMOOTH_SHARE * usual_move, 1.0))


def cleaned(markers: Markers) -> Markers:
    """Return a waved wand without outliers, and with swapped ends swapped back."""
    if not len(markers):
        return markers
    points, sigma = _dense(markers)
    courses = _courses(points)
    crossed = _miss(points[:, ::-1], courses).max(axis=1) < _SWAP_RATIO * _miss(points, courses).max(axis=1)
    points[crossed], sigma[crossed] = points[crossed, ::-1], sigma[crossed, ::-1]
    off = _miss(points, _courses(points))
    usual = float(np.median(off[np.isfinite(off)])) if np.isfinite(off).any() else 0.0
    lost = ~(off <= max(_OUTLIER_RATIO * usual, _ACCEPTED_DISTANCE))
    points[lost], sigma[lost] = np.nan, np.nan
    kept = np.flatnonzero(np.isfinite(sigma).any(axis=1))
    return Markers(markers.frames[0] + kept, points[kept], sigma[kept])


def _dense(markers: Markers) -> tuple[Array, Array]:
    """Return points (F, m, 2) and sigma (F, m) on every frame from the first to the last."""
    at = markers.frames - markers.frames[0]
    points = np.full((at[-1] + 1, *markers.points.shape[1:]), np.nan)
    sigma = np.full(points.shape[:2], np.nan)
    points[at] = np.where(markers.seen[..., None], markers.points, np.nan)
    sigma[at] = np.where(markers.seen, markers.sigma, np.nan)
    return points, sigma


def _courses(points: Array) -> Array:
    """Return positions of balls predicted from pairs of neighbours, one on each side, shape (pairs, F, m, 2)."""
    F = len(points)
    padded = np.pad(points, ((_REACH, _REACH), (0, 0), (0, 0)), constant_values=np.nan)
    return np.stack(
        [
            (k * padded[_REACH + m : _REACH + m + F] + m * padded[_REACH - k : _REACH - k + F]) / (k + m)
            for k in range(1, _REACH + 1)
            for m in range(1, _REACH + 1)
        ]
    )


def _miss(points: Array, courses: Array) -> Array:
    """Return distances (F, m) of balls from the second nearest of their predictions, as neighbours may be wrong,
    too.
    """
    apart = np.linalg.norm(points - courses, axis=-1)
    return np.asarray(np.sort(np.where(np.isfinite(apart), apart, np.inf), axis=0)[1])


def sampled(markers: Markers, frames: Array) -> tuple[Array, Array]:
    """Return points (n, m, 2) and sigma (n, m) at fractional frames of a video, from splines through a waved wand."""
    n, m = len(frames), markers.points.shape[1]
    points, sigma = np.full((n, m, 2), np.nan), np.full((n, m), np.nan)
    for b in range(m):
        seen = markers.seen[:, b]
        at = markers.frames[seen].astype(float)
        if len(at) < 2:
            continue
        after = np.clip(np.searchsorted(at, frames), 1, len(at) - 1)
        inside = (frames >= at[0]) & (frames <= at[-1]) & (at[after] - at[after - 1] <= _MAX_GAP)
        points[inside, b] = CubicSpline(at, markers.points[seen, b])(frames[inside])
        sigma[inside, b] = np.maximum(*(markers.sigma[seen, b][after - k][inside] for k in (0, 1)))
    return points, sigma


def picked(markers: Markers, frames: Ints) -> tuple[Array, Array]:
    """Return points (n, m, 2) and sigma (n, m) on integer frames of a video, NaN where there are none."""
    n, m = len(frames), markers.points.shape[1]
    points, sigma = np.full((n, m, 2), np.nan), np.full((n, m), np.nan)
    _, here, there = np.intersect1d(frames, markers.frames, return_indices=True)
    points[here], sigma[here] = markers.points[there], markers.sigma[there]
    return points, sigma


def synchronised(wands: Sequence[Markers], rate: Array, offset: Array) -> Tracks:
    """Return all views on the capture's frames: frame s is frame rate s + offset of a view's video.

    Nothing is interpolated if that is an integer in all views.
    """
    spans = [(m.frames[[0, -1]] - o) / r for m, r, o in zip(wands, rate, offset, strict=True) if len(m)]
    first, last = min(span[0] for span in spans), max(span[1] for span in spans)
    frames = np.arange(int(np.floor(first)), int(np.ceil(last)) + 1)
    whole = bool((rate == 1).all() and (offset == np.round(offset)).all())
    views = [
        picked(m, frames + int(o)) if whole else sampled(m, r * frames + o)
        for m, r, o in zip(wands, rate, offset, strict=True)
    ]
    tracks = Tracks(frames, np.stack([p for p, _ in views]), np.stack([s for _, s in views]))
    return tracks.take(tracks.seen.any(axis=(0, 2)))
