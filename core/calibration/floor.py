"""The floor from a wand that lay on it in two places, if there is no L-frame.

The four positions of its ends replace the L-frame's balls: their common plane is the floor, and their positions in it
are measured by the cameras themselves instead of by hand.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ..capture.calibration_objects import LFRAME_BALLS, WAND_BALLS
from ..capture.capture import Capture, Markers
from ..numerics.arrays import Array
from . import findings
from .lframe.lframe_pose import resting
from .solving.camera_rig import Rig
from .solving.wand_triangulation import rays, triangulated

_MAX_MOVEMENT = 4.0
"""Largest apparent movement of a ball at rest, standard deviations."""
_MOVEMENT_TOLERANCE = 1.0  # apparent movement that is always tolerated
_MIN_SEPARATION = 0.2
"""Least distance of the second place from the line through the first, relative to the wand's length."""


def with_wand_on_floor(capture: Capture, rig: Rig) -> tuple[Capture, findings.Finding]:
    """Return the capture with the wand on the floor in place of an L-frame, and a finding about it.

    The origin is on the floor, below the centre of the wand's first ball in the first place; x points along the wand to
    its second ball, and z up.

    Parameters
    ----------
    capture : Capture
        With `floor`.
    rig : Rig
        Cameras in any world, and their clocks.

    Raises
    ------
    CaptureError
        The wand is not seen at rest on these frames by two cameras, or both places are on one line.
    """
    lying = [_at_rest(capture.floor, view.wand, rig, c) for c, view in enumerate(capture.views)]
    seen = resting(lying)
    points = np.full((len(rig), LFRAME_BALLS, 2), np.nan)
    points[seen.camera, seen.ball] = seen.uv
    balls = triangulated(rig.centres_world, rays(rig, points))
    if not np.isfinite(balls).all():
        missing = int(np.flatnonzero(~np.isfinite(balls).all(axis=1))[0])
        raise findings.floor_unseen(*capture.floor[missing // WAND_BALLS]).error()
    measures, misfit = _on_floor(balls, rig.centres_world, capture.floor_height)
    if abs(measures[2:, 1]).max() < _MIN_SEPARATION * capture.wand_length:
        raise findings.floor_in_a_line().error()
    views = tuple(replace(view, lframe=markers) for view, markers in zip(capture.views, lying, strict=True))
    return replace(capture, lframe_points=measures, views=views), findings.floor_by_wand(misfit)


def _at_rest(floor: Sequence[tuple[int, int]], wand: Markers, rig: Rig, c: int) -> Markers:
    """Return the wand's balls in both places as the four balls of an L-frame, on frames on which it is at rest."""
    times = rig.times(np.full(len(wand), c), wand.frames.astype(float))
    points = np.full((len(wand), LFRAME_BALLS, 2), np.nan)
    sigma = np.full((len(wand), LFRAME_BALLS), np.nan)
    for place, (first, last) in enumerate(floor):
        during = (times >= first) & (times <= last)
        own = slice(WAND_BALLS * place, WAND_BALLS * (place + 1))
        middle = np.median(wand.points[during & wand.seen.all(axis=1)], axis=0) if during.any() else np.nan
        aside = np.linalg.norm(wand.points - middle, axis=-1)
        during = during[:, None] & (aside < np.maximum(_MAX_MOVEMENT * wand.sigma, _MOVEMENT_TOLERANCE))
        points[:, own][during], sigma[:, own][during] = wand.points[during], wand.sigma[during]
    return Markers(wand.frames, points, sigma)


def _on_floor(balls: Array, centres: Array, height: float) -> tuple[Array, float]:
    """Return the balls in the floor's world, shape (4, 3), all at the same height, and their distance from one
    plane.
    """
    middle = balls.mean(axis=0)
    up = np.linalg.svd(balls - middle)[2][2]
    up = up * np.sign(np.median((centres - middle) @ up))
    misfit = float(np.abs((balls - middle) @ up).max())
    x = balls[1] - balls[0]
    x = x - (x @ up) * up
    x /= np.linalg.norm(x)
    off = balls - balls[0]
    return np.stack([off @ x, off @ np.cross(up, x), np.full(LFRAME_BALLS, height)], axis=1), misfit
