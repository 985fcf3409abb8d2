"""Matching the balls in a view with the ends of a wand whose positions are known."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..capture.capture import CaptureView, Markers
from ..numerics.arrays import Array, Ints
from .solving.ball_observations import BallObservations
from .solving.bundle_residuals import predicted
from .solving.bundle_scene import Scene
from .solving.wand_triangulation import GATE_SIGMAS


@dataclass(frozen=True, eq=False)
class Matches:
    """Balls that were matched with ends of the wand.

    Attributes
    ----------
    row : ndarray of int, shape (n,)
        Row of the markers.
    end : ndarray of int, shape (n,)
        End of the wand, 0 or 1.
    ball : ndarray of int, shape (n,)
        Index among the markers' balls: the other one if the ends are swapped.
    aside : ndarray, shape (n, 2)
        Observed minus predicted positions, pixels.
    """

    row: Ints
    end: Ints
    ball: Ints
    aside: Array

    def observations(self, view: int, markers: Markers) -> BallObservations:
        """Return the matched balls as observations for the adjustment."""
        at = markers.frames[self.row].astype(float)
        points, sigma = markers.points[self.row, self.ball], markers.sigma[self.row, self.ball]
        longer = None if markers.elongation is None else markers.elongation[self.row, self.ball]
        return BallObservations(np.full(len(at), view), self.end, at, points, sigma, longer)


def matched(scene: Scene, view: int, markers: Markers, reach: Array) -> Matches:
    """Match the balls of one view with the ends of the wand, swapped on frames where that fits better.

    Parameters
    ----------
    scene : Scene
    view : int
    markers : Markers
        The wand's balls in that view, on n frames.
    reach : ndarray, shape (n, 2)
        Largest distance of a ball from its predicted position, pixels.
    """
    n = len(markers)
    aside = np.full((n, 2, 2, 2), np.nan)  # row, end, ball, coordinate
    for end in range(2):
        camera, ball = np.full(n, view), np.full(n, end)
        asked = BallObservations(camera, ball, markers.frames.astype(float), np.zeros((n, 2)), np.ones(n))
        uv, reached = predicted(scene, asked)
        aside[:, end] = np.where(reached[:, None, None], markers.points - uv[:, None], np.nan)
    far = np.linalg.norm(aside, axis=-1) / reach[:, None]
    cost = np.minimum(np.nan_to_num(far, nan=np.inf), 1.0) ** 2
    crossed = cost[:, 0, 1] + cost[:, 1, 0] < cost[:, 0, 0] + cost[:, 1, 1]
    own = np.where(crossed[:, None], [1, 0], [0, 1])
    rows, ends = np.nonzero(np.take_along_axis(cost, own[..., None], axis=2)[..., 0] < 1)
    return Matches(rows, ends, own[rows, ends], aside[rows, ends, own[rows, ends]])


def labelled(scene: Scene, views: Sequence[CaptureView], noise: float) -> tuple[BallObservations, Array]:
    """Return the balls of all views that the scene's wand explains, with ends in order, and their fraction per view."""
    matches = [matched(scene, v, view.wand, GATE_SIGMAS * noise * view.wand.sigma) for v, view in enumerate(views)]
    parts = [found.observations(v, views[v].wand) for v, found in enumerate(matches)]
    shares = [len(found.row) / max(view.wand.seen.sum(), 1) for found, view in zip(matches, views, strict=True)]
    return BallObservations.joined(parts), np.array(shares)
