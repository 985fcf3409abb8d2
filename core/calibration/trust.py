"""How far solved cameras can be trusted, in numbers."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .bundle import Observations
from .capture import Markers
from .rig import Rig
from .tracks import sampled
from .triangulation import rays, triangulated

Array = NDArray[np.float64]


def measured_lengths(rig: Rig, seen: Observations, frames: NDArray[np.int64]) -> Array:
    """Lengths of the wand, shape (n,), metres, its ends triangulated one by one, on frames where both are seen."""
    points = np.full((len(rig), len(frames), 2, 2), np.nan)
    for c in range(len(rig)):
        own = seen.take(seen.camera == c)
        track = _track(own)
        at = rig.rate[c] * (1 + rig.drift[c]) * frames + rig.offset[c]
        if len(track):
            points[c] = _at(track, at)
    ends = triangulated(rig.centres_world, rays(rig, points))
    lengths = np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1)
    return lengths[np.isfinite(lengths)]


def _track(seen: Observations) -> Markers:
    """One camera's balls as markers."""
    frames, row = np.unique(seen.frame.astype(np.int64), return_inverse=True)
    points, sigma = np.full((len(frames), 2, 2), np.nan), np.full((len(frames), 2), np.nan)
    points[row, seen.ball], sigma[row, seen.ball] = seen.uv, seen.sigma
    return Markers(frames, points, sigma)


def _at(track: Markers, frames: Array) -> Array:
    """Balls at frames, as they are where those are whole, else interpolated."""
    if np.abs(frames - np.round(frames)).max(initial=0.0) > 1e-6:
        return sampled(track, frames)[0]
    out = np.full((len(frames), 2, 2), np.nan)
    _, here, there = np.intersect1d(np.round(frames).astype(np.int64), track.frames, return_indices=True)
    out[here] = track.points[there]
    return out
