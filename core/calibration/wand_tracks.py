"""The wand's paths through the pictures: cleaned, and brought to common frames."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from ..capture.capture import Markers
from ..numerics.arrays import Array, Ints

_REACH = 4
"""Frames on either side from which a track's middle course is judged."""
_SMOOTH_SHARE = 0.35
"""Of a waved wand, how far balls lie off the middle of their neighbours, beside how far they move."""
_OUTLIER = 6.0
"""Balls that lie this many usual distances off their course are not the wand's."""
_SWAPPED = 0.3
"""Ends that lie so much nearer to each other's course than to their own are swapped."""
_STEADY = 3.0
"""Pixels off its course at which a ball is not doubted."""
_USUAL = 0.3
"""Quantile that is robust against wrong balls."""
_ENOUGH = 10  # frames by which a path can be told
_BRIDGED = 4
"""Frames between two balls of a track across which it is interpolated."""


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
        """The tracks on some of the frames."""
        return Tracks(self.frames[frames], self.points[:, frames], self.sigma[:, frames])

    def views(self, chosen: Sequence[int]) -> Tracks:
        """The tracks of some of the views."""
        return replace(self, points=self.points[list(chosen)], sigma=self.sigma[list(chosen)])


def is_waved(markers: Markers) -> bool:
    """Whether the balls move smoothly from frame to frame, so that they can be interpolated between frames."""
    if not len(markers):
        return False
    points = _dense(markers)[0]
    bend = np.linalg.norm(points[1:-1] - (points[2:] + points[:-2]) / 2, axis=-1)
    move = np.linalg.norm(points[2:] - points[:-2], axis=-1) / 2
    known = np.isfinite(bend)
    if known.sum() < _ENOUGH:
        return False
    # A low quantile: of three balls in a row, one is often wrong.
    usual_bend, usual_move = np.quantile(bend[known], _USUAL), np.quantile(move[known], _USUAL)
    return bool(usual_bend < max(_SMOOTH_SHARE * usual_move, 1.0))


def cleaned(markers: Markers) -> Markers:
    """A waved wand without balls that leave their course, and with swapped ends swapped back."""
    if not len(markers):
        return markers
    points, sigma = _dense(markers)
    courses = _courses(points)
    crossed = _miss(points[:, ::-1], courses).max(axis=1) < _SWAPPED * _miss(points, courses).max(axis=1)
    points[crossed], sigma[crossed] = points[crossed, ::-1], sigma[crossed, ::-1]
    off = _miss(points, _courses(points))
    usual = float(np.median(off[np.isfinite(off)])) if np.isfinite(off).any() else 0.0
    lost = ~(off <= max(_OUTLIER * usual, _STEADY))
    points[lost], sigma[lost] = np.nan, np.nan
    kept = np.flatnonzero(np.isfinite(sigma).any(axis=1))
    return Markers(markers.frames[0] + kept, points[kept], sigma[kept])


def _dense(markers: Markers) -> tuple[Array, Array]:
    """Points (F, m, 2) and sigma (F, m) on every frame from the first to the last."""
    at = markers.frames - markers.frames[0]
    points = np.full((at[-1] + 1, *markers.points.shape[1:]), np.nan)
    sigma = np.full(points.shape[:2], np.nan)
    points[at] = np.where(markers.seen[..., None], markers.points, np.nan)
    sigma[at] = np.where(markers.seen, markers.sigma, np.nan)
    return points, sigma


def _courses(points: Array) -> Array:
    """Positions of balls interpolated from pairs of neighbours, one on each side: shape (pairs, F, m, 2)."""
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
    """Distance of balls, shape (F, m), to the second nearest of their courses: neighbours are wrong at times, too."""
    apart = np.linalg.norm(points - courses, axis=-1)
    return np.asarray(np.sort(np.where(np.isfinite(apart), apart, np.inf), axis=0)[1])


def sampled(markers: Markers, frames: Array) -> tuple[Array, Array]:
    """Points (n, m, 2) and sigma (n, m) at fractional frames of a video, by splines through a waved wand's balls."""
    n, m = len(frames), markers.points.shape[1]
    points, sigma = np.full((n, m, 2), np.nan), np.full((n, m), np.nan)
    for b in range(m):
        seen = markers.seen[:, b]
        at = markers.frames[seen].astype(float)
        if len(at) < 2:
            continue
        after = np.clip(np.searchsorted(at, frames), 1, len(at) - 1)
        inside = (frames >= at[0]) & (frames <= at[-1]) & (at[after] - at[after - 1] <= _BRIDGED)
        points[inside, b] = CubicSpline(at, markers.points[seen, b])(frames[inside])
        sigma[inside, b] = np.maximum(*(markers.sigma[seen, b][after - k][inside] for k in (0, 1)))
    return points, sigma


def picked(markers: Markers, frames: Ints) -> tuple[Array, Array]:
    """Points (n, m, 2) and sigma (n, m) on whole frames of a video, NaN where there is none."""
    n, m = len(frames), markers.points.shape[1]
    points, sigma = np.full((n, m, 2), np.nan), np.full((n, m), np.nan)
    _, here, there = np.intersect1d(frames, markers.frames, return_indices=True)
    points[here], sigma[here] = markers.points[there], markers.sigma[there]
    return points, sigma


def synchronised(wands: Sequence[Markers], rate: Array, offset: Array) -> Tracks:
    """All views on the capture's frames: frame s is frame rate s + offset of a view's video.

    Where that is a whole frame for all, nothing is interpolated.
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
