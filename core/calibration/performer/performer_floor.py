"""The floor from a performer who stood upright in some places, for captures without an L-frame or a wand on the floor.

Both the soles, which lie on the floor, and the direction from the feet to the head, which is vertical on average, show
how the floor is tilted. The performer's height gives the scale if the wand's length is not known.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ...capture.calibration_objects import LFRAME_BALLS, PERFORMER_POINTS
from ...capture.capture import Capture, Markers, StandingPerformer
from ...numerics.arrays import Array
from .. import findings
from ..findings import Finding
from ..solving.camera_rig import Rig
from ..solving.wand_triangulation import rays, triangulated

SOLE_SIGMA = 0.01
"""Standard deviation of a marked sole from the floor, metres."""
HEAD_SIGMA = 0.05
"""Standard deviation, in both horizontal directions, of an upright person's head from above the middle of the feet,
metres."""
POINT_SIGMA = 0.02
"""Standard deviation between the points that were marked in different views for the same foot or head, metres."""
_MAX_HEIGHT_SPREAD = 0.05
"""Largest difference between the heights found in different places, as a share, for somebody who stands upright."""
_MAX_HEIGHT_ERROR = 0.1
"""Largest relative difference from the stated height that shoes and hair can explain."""
_HEAD = PERFORMER_POINTS - 1
"""Index of the top of the head among the points of a place, after those of the feet."""


@dataclass(frozen=True, eq=False)
class PerformersFloor:
    """The world as found from a performer who stood on the floor.

    Attributes
    ----------
    capture : Capture
        The capture with three of the performer's points in the first place, and one in another place, instead of the
        balls of an L-frame, metres.
    scale : float
        Scale of this world relative to the one of the given cameras.
    finding : Finding
        Warnings for the user.
    """

    capture: Capture
    scale: float
    finding: Finding


def on_performers_floor(capture: Capture, rig: Rig) -> PerformersFloor:
    """Find the world of a performer: z up from the floor, origin between the feet in the first place, x to their left.

    Parameters
    ----------
    capture : Capture
        With `performer`.
    rig : Rig
        Cameras in any world whose scale is that of the wand's length in the capture, and their clocks.

    Raises
    ------
    CaptureError
        The performer is not seen by two cameras in each place, does not stand upright, or does not have the stated
        height.
    """
    performer = capture.performer
    assert performer is not None
    seen = _seen(performer, rig)
    points = np.stack([triangulated(rig.centres_world, rays(rig, uv)) for uv in seen.swapaxes(0, 1)])
    if not np.isfinite(points).all():
        missing = int(np.flatnonzero(~np.isfinite(points).all(axis=(1, 2)))[0])
        raise findings.performer_unseen(*performer.places[missing]).error()
    feet, head = points[:, :_HEAD], points[:, _HEAD]
    up, tilt = _vertical(feet, head)
    floor = feet.reshape(-1, 3).mean(axis=0)
    heights = (head - floor) @ up
    found = float(np.median(heights))
    scale = performer.height / found if performer.gives_scale else 1.0
    if heights.min() <= 0 or np.ptp(heights) > _MAX_HEIGHT_SPREAD * found:
        raise findings.performer_not_upright(scale * float(np.ptp(heights))).error()
    if abs(scale * found / performer.height - 1) > _MAX_HEIGHT_ERROR:
        raise findings.performer_wrong_height(found, performer.height).error()
    chosen = _far_apart(feet)
    balls = points.reshape(-1, 3)[chosen]
    measures = scale * _in_world(balls, feet[0], floor, up)
    views = []
    for c, view in enumerate(capture.views):
        sigma = _pixels(rig, c, balls, POINT_SIGMA)
        uv = seen[c].reshape(-1, 2)[chosen]
        markers = Markers(np.zeros(1, np.int64), uv[None], np.where(np.isfinite(uv[:, 0]), sigma, np.nan)[None])
        views.append(replace(view, lframe=markers))
    finding = findings.floor_by_performer(scale * found, float(np.rad2deg(tilt)), scaled=performer.gives_scale)
    length = scale * capture.wand_length
    capture = replace(capture, lframe_points=measures, views=tuple(views), wand_length=length)
    return PerformersFloor(capture, scale, finding)


def _seen(performer: StandingPerformer, rig: Rig) -> Array:
    """Median position of each point in each place, by camera, pixels, shape (C, P, 3, 2); NaN where it is not
    marked.
    """
    out = np.full((len(rig), len(performer.places), PERFORMER_POINTS, 2), np.nan)
    for c, name in enumerate(rig.names):
        if (markers := performer.points.get(name)) is None:
            continue
        times = rig.times(np.full(len(markers), c), markers.frames.astype(float))
        for place, (first, last) in enumerate(performer.places):
            for k in range(PERFORMER_POINTS):
                during = (times >= first) & (times <= last) & markers.seen[:, k]
                if during.any():
                    out[c, place, k] = np.median(markers.points[during, k], axis=0)
    return out


def _vertical(feet: Array, head: Array) -> tuple[Array, float]:
    """Return the upward unit vector by least squares, and the standard deviation of its tilt in the worst direction,
    radians.

    Parameters
    ----------
    feet : ndarray, shape (P, 2, 3)
    head : ndarray, shape (P, 3)
    """
    soles = feet.reshape(-1, 3) - feet.reshape(-1, 3).mean(axis=0)
    tall = head - feet.mean(axis=1)
    values, vectors = np.linalg.eigh(soles.T @ soles / SOLE_SIGMA**2 - tall.T @ tall / HEAD_SIGMA**2)
    up = vectors[:, 0] * np.sign(tall.sum(axis=0) @ vectors[:, 0])
    return up, float(1 / np.sqrt(values[1] - values[0]))


def _far_apart(feet: Array) -> list[int]:
    """Return the indices of four points: both feet and the head in the first place, and the left foot farthest from
    there.
    """
    places = feet.mean(axis=1)
    other = int(np.linalg.norm(places - places[0], axis=1).argmax())
    chosen = [0, 1, _HEAD, other * PERFORMER_POINTS]
    assert len(chosen) == LFRAME_BALLS
    return chosen


def _in_world(points: Array, feet: Array, floor: Array, up: Array) -> Array:
    """Return the points with the origin between two feet and x from the right one to the left, on the floor."""
    x = feet[0] - feet[1]
    x = x - (x @ up) * up
    x /= np.linalg.norm(x)
    off = points - feet.mean(axis=0)
    return np.stack([off @ x, off @ np.cross(up, x), (points - floor) @ up], axis=1)


def _pixels(rig: Rig, c: int, points: Array, length: float) -> Array:
    """Apparent length in pixels of a `length` across the ray of a camera, at each point."""
    distance = np.linalg.norm(points - rig.centres_world[c], axis=1)
    return np.asarray(rig.focal[c].mean() * length / distance)
