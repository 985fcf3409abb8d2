"""The floor from a performer who stood upright in some places, where there is neither an L-frame nor a wand on it.

Their soles lie on the floor, and on the average their head is above their feet: both tell how it is tilted. Their
height gives the scale where the wand's length is not known.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..capture.capture import LFRAME_BALLS, PERFORMER_POINTS, Capture, Markers, StandingPerformer
from ..numerics.arrays import Array
from . import findings
from .camera_rig import Rig
from .findings import Finding
from .wand_triangulation import rays, triangulated

SOLE_SIGMA = 0.01
"""How far off the floor the point may be that is taken for a sole's, metres."""
HEAD_SIGMA = 0.05
"""How far beside the middle of the feet the head of somebody is who stands upright, metres, each way."""
POINT_SIGMA = 0.02
"""How far apart the points are that different views take for the same foot or the same head, metres."""
_UNEVEN = 0.05
"""Differences of the heights in different places, as a share, which nobody has who stands upright."""
_WRONG_HEIGHT = 0.1
"""A share that no shoes and no hair explain."""
_HEAD = PERFORMER_POINTS - 1


@dataclass(frozen=True, eq=False)
class PerformersFloor:
    """What a performer tells of the world.

    Attributes
    ----------
    capture : Capture
        With three points of their first place and one of another in place of the L-frame's balls; metres.
    scale : float
        How many times as large the world is as the one that the cameras were in.
    finding : Finding
        What to say about it.
    """

    capture: Capture
    scale: float
    finding: Finding


def on_performers_floor(capture: Capture, rig: Rig) -> PerformersFloor:
    """The world of a performer: z up from the floor, origin between their feet in the first place, x towards the left.

    Parameters
    ----------
    capture : Capture
        With `performer`.
    rig : Rig
        Cameras in any world whose scale is that of the wand's length in the capture, and their clocks.

    Raises
    ------
    CaptureError
        They are not seen by two cameras in each place, do not stand upright, or are not as tall as is said.
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
    if heights.min() <= 0 or np.ptp(heights) > _UNEVEN * found:
        raise findings.performer_not_upright(scale * float(np.ptp(heights))).error()
    if abs(scale * found / performer.height - 1) > _WRONG_HEIGHT:
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
    """The median of each point in each place by camera, pixels, shape (C, P, 3, 2); NaN where it was not marked."""
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
    """The upward unit vector that leaves the least sum of squares, and the deviation of its worst tilt, radians.

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
    """Both feet and the head in the first place, and the left foot in the place farthest from it, among all points."""
    places = feet.mean(axis=1)
    other = int(np.linalg.norm(places - places[0], axis=1).argmax())
    chosen = [0, 1, _HEAD, other * PERFORMER_POINTS]
    assert len(chosen) == LFRAME_BALLS
    return chosen


def _in_world(points: Array, feet: Array, floor: Array, up: Array) -> Array:
    """Points with the origin between two feet and x from the right one to the left, on the floor."""
    x = feet[0] - feet[1]
    x = x - (x @ up) * up
    x /= np.linalg.norm(x)
    off = points - feet.mean(axis=0)
    return np.stack([off @ x, off @ np.cross(up, x), (points - floor) @ up], axis=1)


def _pixels(rig: Rig, c: int, points: Array, length: float) -> Array:
    """How long a length looks across the ray of a camera to each point."""
    distance = np.linalg.norm(points - rig.centres_world[c], axis=1)
    return np.asarray(rig.focal[c].mean() * length / distance)
