"""Triangulating the wand with known cameras, robustly against wrong balls and swapped ends."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import combinations, product

import cv2
import numpy as np
from numpy.typing import NDArray

from ...numerics.arrays import Array, Ints
from .camera_rig import Rig
from .wand_motion import Wand
from .wand_tracks import Tracks

_MIN_PARALLAX = np.deg2rad(3.0)
"""Smallest angle between two rays that are triangulated."""
_MIN_LONE_VIEWS = 3
"""Number of views that must agree on one end if the other, and so the length, is unknown."""
GATE_SIGMAS = 4.0
"""Largest residual of a ball that is the wand's, standard deviations."""


def rays(rig: Rig, points: Array) -> Array:
    """Return the world directions, as unit vectors (C, ..., 3), of pixels (C, ..., 2)."""
    out = np.full((*points.shape[:-1], 3), np.nan)
    for c in range(len(rig)):
        uv = points[c].reshape(-1, 2)
        known = np.isfinite(uv).all(axis=1)
        if known.any():
            flat = np.full((len(uv), 3), np.nan)
            criteria = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 40, 1e-10)
            xy = cv2.undistortPointsIter(uv[known, None], rig.matrix(c), rig.distortions[c], None, None, criteria)
            flat[known] = np.column_stack([xy[:, 0], np.ones(known.sum())]) @ rig.R_cam_world[c]
            out[c] = flat.reshape(out[c].shape)
    return np.asarray(out / np.linalg.norm(out, axis=-1, keepdims=True))


def triangulated(centres: Array, directions: Array, weight: Array | None = None) -> Array:
    """Return the points nearest to rays, shape (..., 3); NaN if fewer than two are known, or all are nearly parallel.

    Parameters
    ----------
    centres : ndarray, shape (V, 3)
    directions : ndarray, shape (V, ..., 3)
        Unit vectors; NaN where a view has no ray.
    weight : ndarray, shape (V, ...), optional
    """
    known = np.isfinite(directions).all(axis=-1)
    d = np.where(known[..., None], directions, 0.0)
    w = known.astype(float) if weight is None else np.where(known, weight, 0.0)
    across = w[..., None, None] * (np.eye(3) - d[..., :, None] * d[..., None, :])
    places = np.broadcast_to(
        centres.reshape(len(centres), *(1,) * (d.ndim - centres.ndim), *centres.shape[1:]), d.shape
    )
    A, b = across.sum(axis=0), np.einsum("v...ij,v...j->...i", across, places)
    # For two rays, the determinant is 2 sin^2 of their angle and the trace is 4.
    enough = np.linalg.det(A) > np.sin(_MIN_PARALLAX) ** 2 / 32 * np.trace(A, axis1=-2, axis2=-1) ** 3
    enough &= known.sum(axis=0) >= 2
    A = np.where(enough[..., None, None], A, np.eye(3))
    return np.where(enough[..., None], np.linalg.solve(A, b[..., None])[..., 0], np.nan)


def projected(rig: Rig, c: int, points_world: Array) -> Array:
    """Project points (..., 3) to pixels (..., 2) of one camera; NaN behind it."""
    x = points_world.reshape(-1, 3) @ rig.R_cam_world[c].T + rig.t_cam_world[c]
    front = x[:, 2] > 1e-6
    uv = np.full((len(x), 2), np.nan)
    if front.any():
        zero = np.zeros(3)
        uv[front] = cv2.projectPoints(x[front, None], zero, zero, rig.matrix(c), rig.distortions[c])[0][:, 0]
    return uv.reshape(*points_world.shape[:-1], 2)


@dataclass(frozen=True, eq=False)
class WandSighting:
    """The wand triangulated on n frames.

    Attributes
    ----------
    ends_world : ndarray, shape (n, 2, 3)
        The ends, independent of each other, metres; NaN where fewer than two views agree.
    ball : ndarray of int, shape (V, n, 2)
        Index of the ball that is this end in each view; -1 if there is none.
    """

    ends_world: Array
    ball: Ints

    @property
    def known(self) -> NDArray[np.bool_]:
        """Whether both ends are known on each frame, shape (n,)."""
        return np.asarray(np.isfinite(self.ends_world).all(axis=(1, 2)))

    def wand(self, frames: Ints, length: float, single: bool = False) -> Wand:
        """Return a wand of a length on the frames whose ends are known.

        Parameters
        ----------
        frames : ndarray of int, shape (n,)
            Frames of the capture.
        length : float
            Metres.
        single : bool
            Whether to include frames on which only one end is known; the direction is arbitrary there.
        """
        one = np.isfinite(self.ends_world).all(axis=2)
        ends = self.ends_world.copy()
        for end, other in ((0, 1), (1, 0)):
            alone = one[:, end] & ~one[:, other] & single
            ends[alone, other] = ends[alone, end] + [0.0, 0.0, length]
        kept = np.isfinite(ends).all(axis=(1, 2))
        across = ends[kept, 0] - ends[kept, 1]
        direction = across / np.linalg.norm(across, axis=1, keepdims=True)
        return Wand(frames[kept], ends[kept].mean(axis=1), direction, length)


def sight(rig: Rig, tracks: Tracks, length: float, noise: float = 1.0, tolerance: float = 0.1) -> WandSighting:
    """Find the wand by consensus: of all points on which two views agree, the two that most views see.

    Parameters
    ----------
    rig : Rig
    tracks : Tracks
    length : float
        Length of the wand, metres.
    noise : float
        Noise of the balls as a multiple of their sigma, which includes the cameras' own errors.
    tolerance : float
        Largest relative error of the wand's length.
    """
    candidates = _candidates(rig, tracks)
    off = np.stack([_misses(rig, v, candidates, tracks, noise) for v in range(len(rig))])  # (V, K, n, 2 balls)
    cost = np.minimum(off, GATE_SIGMAS**2).min(axis=-1).sum(axis=0)
    cost[(off < GATE_SIGMAS**2).any(axis=-1).sum(axis=0) < 2] = np.inf
    column = np.arange(len(tracks.frames))
    first = np.argmin(cost, axis=0)
    apart = np.linalg.norm(candidates - candidates[first, column], axis=-1)
    fits = (np.abs(apart / length - 1) < tolerance) & ~_shares_a_ball(off, off[:, first, column])
    partner = np.where(fits, cost, np.inf)
    second = np.argmin(partner, axis=0)
    ends = np.stack([candidates[first, column], candidates[second, column]], axis=1)
    ball = np.stack([_nearest(off[:, chosen, column]) for chosen in (first, second)], axis=2)
    both = np.isfinite(cost[first, column]) & np.isfinite(partner[second, column])
    alone = ~both & ((ball[:, :, 0] >= 0).sum(axis=0) >= _MIN_LONE_VIEWS)
    ball[:, ~both, 1], ball[:, ~both & ~alone, 0] = -1, -1
    ends[~both, 1], ends[~both & ~alone, 0] = np.nan, np.nan
    return refined_ends(rig, tracks, _named(WandSighting(ends, ball)))


def _candidates(rig: Rig, tracks: Tracks) -> Array:
    """Return where every ball of a view meets every ball of another, shape (K, n, 3)."""
    directions, centres = rays(rig, tracks.points), rig.centres_world
    pairs = product(combinations(range(len(rig)), 2), range(2), range(2))
    return np.stack(
        [triangulated(centres[[v, w]], np.stack([directions[v, :, p], directions[w, :, q]])) for (v, w), p, q in pairs]
    )


def _nearest(off: Array) -> Ints:
    """Return which ball is a point's, -1 where neither is; squared distances have the shape (..., 2)."""
    return np.where(off.min(axis=-1) < GATE_SIGMAS**2, off.argmin(axis=-1), -1)


def _shares_a_ball(off: Array, chosen: Array) -> NDArray[np.bool_]:
    """Return which candidates, (V, K, n, 2), take a ball in some view that the chosen ones, (V, n, 2), take; shape (K,
    n).
    """
    own, taken = _nearest(off), _nearest(chosen)[:, None]
    return np.asarray(((own == taken) & (taken >= 0)).any(axis=0))


def _named(sighting: WandSighting) -> WandSighting:
    """Return the ends in the order that most views have them in."""
    ends, ball = sighting.ends_world.copy(), sighting.ball.copy()
    against = (ball == [1, 0]).sum(axis=(0, 2)) > (ball == [0, 1]).sum(axis=(0, 2))
    ends[against], ball[:, against] = ends[against, ::-1], ball[:, against, ::-1]
    return WandSighting(ends, ball)


def _misses(rig: Rig, v: int, points_world: Array, tracks: Tracks, noise: float) -> Array:
    """Squared distances of points (K, n, 3) to both balls of a view, (K, n, 2), in deviations; inf where unseen."""
    uv = projected(rig, v, points_world)
    squared = ((uv[:, :, None] - tracks.points[v]) ** 2).sum(axis=-1) / (noise * tracks.sigma[v]) ** 2
    return np.where(np.isfinite(squared), squared, np.inf)


def refined_ends(rig: Rig, tracks: Tracks, sighting: WandSighting) -> WandSighting:
    """Return the ends from all the views that agree on them."""
    found = np.take_along_axis(tracks.points, np.maximum(sighting.ball, 0)[..., None], axis=2)
    found = np.where((sighting.ball >= 0)[..., None], found, np.nan)
    directions, centres = rays(rig, found), rig.centres_world
    distance = np.linalg.norm(sighting.ends_world - centres[:, None, None], axis=-1)
    weight = (rig.focal.mean(axis=1)[:, None, None] / np.where(np.isfinite(distance), distance, 1.0)) ** 2
    return replace(sighting, ends_world=triangulated(centres, directions, weight))
