"""The L-frame: it lays down the world, and its lengths are held against the wand's."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from . import findings
from .bundle import LFRAME_SIGMA, Observations
from .capture import LFRAME_BALLS, Markers
from .rig import Rig
from .triangulation import projected, rays, triangulated

Array = NDArray[np.float64]

_LASTING = 0.1
"""Share of a ball's standard deviation that no averaging over frames takes away."""
_SCALE_SHARE, _SHAPE_METRES = 0.01, 5e-3
"""Differences in size and shape that no careful measuring explains."""
_SURE = 5.0


def resting(markers: Sequence[Markers]) -> Observations:
    """The balls of an L-frame that lies still, each camera's frames averaged without outliers."""
    rows = []
    for v, view in enumerate(markers):
        for b in range(LFRAME_BALLS):
            seen = view.seen[:, b]
            if not seen.any():
                continue
            points, sigma = view.points[seen, b], view.sigma[seen, b]
            off = np.linalg.norm(points - np.median(points, axis=0), axis=1)
            good = off <= 4 * max(float(np.median(off)), float(np.median(sigma)))
            spread = np.sqrt(np.mean(sigma[good] ** 2))
            lasting = max(1 / np.sqrt(good.sum()), _LASTING)
            rows.append((v, b, points[good].mean(axis=0), spread * lasting))
    uv = np.array([row[2] for row in rows]).reshape(-1, 2)
    camera, ball = (np.array([row[k] for row in rows], int) for k in (0, 1))
    return Observations(camera, ball, np.zeros(len(rows)), uv, np.array([row[3] for row in rows], float))


@dataclass(frozen=True, eq=False)
class Placement:
    """Where the L-frame is, by the wand.

    Attributes
    ----------
    R, t : ndarray, shapes (3, 3) and (3,)
        x_world = R x + t takes what was solved into the L-frame's world.
    scale : float
        How many times larger the L-frame is by the wand than by its own measures.
    misfit : ndarray, shape (4, 3)
        Of its balls after that, the scale taken out, metres; NaN where a ball is not known.
    """

    R: Array
    t: Array
    scale: float
    misfit: Array


def place(rig: Rig, seen: Observations, measures: Array) -> Placement:
    """Lay the world onto the L-frame, without changing the size that the wand gives.

    Raises
    ------
    CaptureError
        Fewer than two cameras see the balls that are needed.
    """
    points = np.full((len(rig), LFRAME_BALLS, 2), np.nan)
    points[seen.camera, seen.ball] = seen.uv
    balls = triangulated(rig.centres_world, rays(rig, points))
    known = np.isfinite(balls).all(axis=1)
    if known.sum() < 3 or _collinear(measures[known]):
        names = ", ".join(str(b + 1) for b in np.flatnonzero(~known))
        raise findings.lframe_unseen(f"fewer than two cameras see the L-frame's balls {names}").error()
    a, b = balls[known] - balls[known].mean(axis=0), measures[known] - measures[known].mean(axis=0)
    R = Rotation.align_vectors(b, a)[0].as_matrix()
    scale = float(np.sqrt((a**2).sum() / (b**2).sum()))
    misfit = np.full((LFRAME_BALLS, 3), np.nan)
    misfit[known] = a @ R.T / scale - b
    return Placement(R, measures[known].mean(axis=0) - R @ balls[known].mean(axis=0), scale, misfit)


def _collinear(points: Array) -> bool:
    spread = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    return bool(spread[1] < 1e-3 * spread[0])


def check(placement: Placement, rig: Rig, measures: Array, length: float, noise: float) -> None:
    """Refuse an L-frame that contradicts the wand or itself.

    Parameters
    ----------
    rig : Rig
        In the L-frame's world.
    noise : float
        How exactly its balls are known, metres, beside the exactness of its measures.

    Raises
    ------
    CaptureError
        Its lengths contradict one another, or the wand's; or it is mirrored.
    """
    sigma = np.hypot(LFRAME_SIGMA, noise)
    miss = np.linalg.norm(placement.misfit, axis=1)
    if np.nanmax(miss) > max(_SHAPE_METRES, _SURE * sigma):
        ball = int(np.nanargmax(miss))
        worst = 1000 * float(np.nanmax(miss))
        what = f"ball {ball + 1} of the L-frame lies {worst:.0f} mm from where the other balls and its measures say"
        raise findings.contradicting(what).error()
    size = np.sqrt(((measures - measures.mean(axis=0)) ** 2).sum())
    if abs(placement.scale - 1) > max(_SCALE_SHARE, _SURE * sigma / size):
        raise findings.wrong_length(placement.scale, length).error()
    if (rig.centres_world[:, 2] < 0).all():
        raise findings.mirrored().error()


def pixels_off(rig: Rig, seen: Observations, balls_world: Array) -> Array:
    """How far each camera sees the L-frame from where it is, shape (C,), pixels: a camera may have been moved since.

    NaN where it sees no ball.
    """
    off = np.full(len(rig), np.nan)
    for c in np.unique(seen.camera):
        own = seen.camera == c
        miss = np.linalg.norm(projected(rig, int(c), balls_world[seen.ball[own]]) - seen.uv[own], axis=1)
        off[c] = np.median(miss)
    return off
