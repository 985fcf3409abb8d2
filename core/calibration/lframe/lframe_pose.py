"""The L-frame: it defines the world frame, and its lengths are compared with the wand's."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from scipy.spatial.transform import Rotation

from ...capture.calibration_objects import LFRAME_BALLS
from ...capture.capture import Markers
from ...numerics.arrays import Array
from .. import findings
from ..solving.ball_observations import BallObservations
from ..solving.bundle_scene import LFRAME_SIGMA
from ..solving.camera_rig import Rig
from ..solving.wand_triangulation import projected, rays, triangulated

_SYSTEMATIC_SHARE = 0.1
"""Fraction of a ball's standard deviation that averaging over frames does not remove."""
_MAX_SCALE_DIFFERENCE, _MAX_SHAPE_DIFFERENCE = 0.01, 5e-3
"""Differences in size (relative) and shape (metres) that careful measuring cannot explain."""
_SIGNIFICANT_SIGMAS = 5.0  # standard deviations
_MOVED_PIXELS = 1.5
"""Shift, pixels, from which a camera is reported as moved between the takes."""


def resting(markers: Sequence[Markers]) -> BallObservations:
    """Return the balls of an L-frame at rest, averaged over each camera's frames without outliers."""
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
            lasting = max(1 / np.sqrt(good.sum()), _SYSTEMATIC_SHARE)
            longer = np.zeros(2) if view.elongation is None else view.elongation[seen, b][0]
            rows.append((v, b, points[good].mean(axis=0), spread * lasting, longer))
    uv = np.array([row[2] for row in rows]).reshape(-1, 2)
    camera, ball = (np.array([row[k] for row in rows], int) for k in (0, 1))
    sigma, longer = np.array([row[3] for row in rows], float), np.array([row[4] for row in rows]).reshape(-1, 2)
    return BallObservations(camera, ball, np.zeros(len(rows)), uv, sigma, longer)


@dataclass(frozen=True, eq=False)
class LFramePose:
    """The pose of the L-frame in a solution from the wand.

    Attributes
    ----------
    R, t : ndarray, shapes (3, 3) and (3,)
        x_world = R x + t maps points of the solution to the L-frame's world.
    scale : float
        Size of the L-frame according to the wand, relative to its own measures.
    misfit : ndarray, shape (4, 3)
        Residuals of its balls after alignment with scale, metres; NaN for unknown balls.
    sigma : float
        Standard deviation of the ball that is measured least precisely, metres.
    """

    R: Array
    t: Array
    scale: float
    misfit: Array
    sigma: float


def place_lframe(rig: Rig, seen: BallObservations, measures: Array, noise: float) -> LFramePose:
    """Align the world frame with the L-frame; the scale stays the wand's.

    Parameters
    ----------
    noise : float
        Noise of the balls, as a multiple of their sigma.

    Raises
    ------
    CaptureError
        Fewer than two cameras see the necessary balls.
    """
    balls = _balls(rig, seen)
    known = np.isfinite(balls).all(axis=1)
    if known.sum() < 3 or _collinear(measures[known]):
        names = ", ".join(str(b + 1) for b in np.flatnonzero(~known))
        balls_named = f"ball {names}" if (~known).sum() == 1 else f"balls {names}"
        raise findings.lframe_unseen(f"fewer than two cameras see the L-frame's {balls_named}").error()
    a, b = balls[known] - balls[known].mean(axis=0), measures[known] - measures[known].mean(axis=0)
    R = Rotation.align_vectors(b, a)[0].as_matrix()
    scale = float(np.sqrt((a**2).sum() / (b**2).sum()))
    misfit = np.full((LFRAME_BALLS, 3), np.nan)
    misfit[known] = a @ R.T / scale - b
    shift = measures[known].mean(axis=0) - R @ balls[known].mean(axis=0)
    return LFramePose(R, shift, scale, misfit, noise * _least_known(rig, seen, balls))


def _least_known(rig: Rig, seen: BallObservations, balls_world: Array) -> float:
    """Return the standard deviation, perpendicular to the rays, of the ball measured least precisely, metres."""
    distance = np.linalg.norm(balls_world[seen.ball] - rig.centres_world[seen.camera], axis=1)
    information = (rig.focal[seen.camera].mean(axis=1) / (seen.sigma * distance)) ** 2
    sums = np.bincount(seen.ball, np.nan_to_num(information), LFRAME_BALLS)
    return float(1 / np.sqrt(sums[np.isfinite(balls_world).all(axis=1)].min()))


def _balls(rig: Rig, seen: BallObservations) -> Array:
    """Triangulate the balls, shape (4, 3)."""
    points = np.full((len(rig), LFRAME_BALLS, 2), np.nan)
    points[seen.camera, seen.ball] = seen.uv
    return triangulated(rig.centres_world, rays(rig, points))


def moved_since(rig: Rig, seen: BallObservations, noise: float) -> dict[int, float]:
    """Return the cameras that see the L-frame in another place than the others do, and by how many pixels.

    The camera that contradicts the others most is removed, until the rest agree.

    Raises
    ------
    CaptureError
        Two cameras contradict each other, and nothing decides which was moved; or their views are exchanged.
    """
    usual = noise * float(np.median(seen.sigma)) if len(seen) else 0.0
    least = max(_MOVED_PIXELS, _SIGNIFICANT_SIGMAS * usual)
    agreeing = sorted({int(c) for c in seen.camera})
    if (pair := _exchanged(rig, seen, agreeing, least)) is not None:
        raise findings.views_exchanged((rig.names[pair[0]], rig.names[pair[1]])).error()
    while len(agreeing) > 1 and _disagreement(rig, seen, agreeing) > least:
        if len(agreeing) == 2:
            names = " or ".join(rig.names[c] for c in agreeing)
            raise findings.camera_moved(
                names,
                "the L-frame and the wand give different positions of this camera, or the wand was waved too briefly",
            ).error()
        rest = [[c for c in agreeing if c != out] for out in agreeing]
        agreeing = min(rest, key=lambda cameras: _disagreement(rig, seen, cameras))
    balls = _balls(rig, seen.take(np.isin(seen.camera, agreeing)))
    off = {c: _off(rig, seen, balls, c) for c in sorted({int(c) for c in seen.camera} - set(agreeing))}
    return {c: pixels for c, pixels in off.items() if pixels > least}


def _exchanged(rig: Rig, seen: BallObservations, cameras: list[int], least: float) -> tuple[int, int] | None:
    """Return two of three or more cameras that disagree, all of which agree if these two exchange their views."""
    if len(cameras) < 3 or _disagreement(rig, seen, cameras) <= least:
        return None
    for pair in combinations(cameras, 2):
        camera = seen.camera.copy()
        for own, other in (pair, pair[::-1]):
            camera[seen.camera == own] = other
        if _disagreement(rig, replace(seen, camera=camera), cameras) <= least:
            return pair
    return None


def _disagreement(rig: Rig, seen: BallObservations, cameras: list[int]) -> float:
    """Return the largest residual among some cameras of the balls that they see together, pixels."""
    own = seen.take(np.isin(seen.camera, cameras))
    balls = _balls(rig, own)
    return max(_off(rig, own, balls, c) for c in cameras)


def _off(rig: Rig, seen: BallObservations, balls_world: Array, c: int) -> float:
    """Return a camera's residual of the balls, pixels; 0 if no ball is known."""
    own = seen.camera == c
    miss = np.linalg.norm(projected(rig, c, balls_world[seen.ball[own]]) - seen.uv[own], axis=1)
    return float(np.median(miss[np.isfinite(miss)])) if np.isfinite(miss).any() else 0.0


def _collinear(points: Array) -> bool:
    spread = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    return bool(spread[1] < 1e-3 * spread[0])


def check_lframe(placement: LFramePose, rig: Rig, measures: Array, length: float) -> None:
    """Check that an L-frame contradicts neither the wand nor itself.

    Parameters
    ----------
    placement : LFramePose
    rig : Rig
        In the L-frame's world.
    measures : ndarray, shape (4, 3)
        The L-frame's balls, metres.
    length : float
        Length of the wand, metres.

    Raises
    ------
    CaptureError
        Its lengths contradict one another, or the wand's; or it is mirrored.
    """
    worst, limit = _worst_ball(placement)
    if worst > limit:
        ball = int(np.nanargmax(np.linalg.norm(placement.misfit, axis=1))) + 1
        what = f"ball {ball} of the L-frame lies {1000 * worst:.0f} mm from where the other balls and its measures say"
        raise findings.contradicting(what).error()
    check_size(placement, measures, length)
    if (rig.centres_world[:, 2] < 0).all():
        raise findings.lframe_mirrored().error()


def check_size(placement: LFramePose, measures: Array, length: float) -> None:
    """Check that an L-frame whose balls fit its measures (4, 3) has their size, too; `length` is the wand's.

    Raises
    ------
    CaptureError
        By the wand, it has another size.
    """
    worst, limit = _worst_ball(placement)
    size = np.sqrt(((measures - measures.mean(axis=0)) ** 2).sum())
    sigma = np.hypot(LFRAME_SIGMA, placement.sigma)
    if worst <= limit and abs(placement.scale - 1) > max(_MAX_SCALE_DIFFERENCE, _SIGNIFICANT_SIGMAS * sigma / size):
        raise findings.wrong_length(placement.scale, length).error()


def _worst_ball(placement: LFramePose) -> tuple[float, float]:
    """Return how far the worst ball is from its place, and how far it may be, metres."""
    limit = max(_MAX_SHAPE_DIFFERENCE, _SIGNIFICANT_SIGMAS * float(np.hypot(LFRAME_SIGMA, placement.sigma)))
    return float(np.nanmax(np.linalg.norm(placement.misfit, axis=1))), limit
