"""Which of the balls in a view are which ends of a wand whose places are known."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..capture.capture import CaptureView, Markers
from ..numerics.arrays import Array, Ints
from .bundle_residuals import BallObservations, Scene, predicted
from .wand_triangulation import GATE


@dataclass(frozen=True, eq=False)
class Matches:
    """Balls that are the wand's.

    Attributes
    ----------
    row : ndarray of int, shape (n,)
        Of the markers.
    end : ndarray of int, shape (n,)
        0 or 1.
    ball : ndarray of int, shape (n,)
        Which of the markers' balls it is: the other one where the ends are swapped.
    aside : ndarray, shape (n, 2)
        Seen less predicted, pixels.
    """

    row: Ints
    end: Ints
    ball: Ints
    aside: Array

    def observations(self, view: int, markers: Markers) -> BallObservations:
        """The matched balls as the adjustment takes them."""
        at = markers.frames[self.row].astype(float)
        points, sigma = markers.points[self.row, self.ball], markers.sigma[self.row, self.ball]
        longer = None if markers.elongation is None else markers.elongation[self.row, self.ball]
        return BallObservations(np.full(len(at), view), self.end, at, points, sigma, longer)


def matched(scene: Scene, view: int, markers: Markers, reach: Array) -> Matches:
    """The balls of one view that lie near an end of the wand, the ends swapped where that fits better.

    Parameters
    ----------
    reach : ndarray, shape (n, 2)
        How far aside a ball may lie, pixels.
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
    """The balls of all views that the scene's wand explains, swapped ends swapped back, and their share by view."""
    matches = [matched(scene, v, view.wand, GATE * noise * view.wand.sigma) for v, view in enumerate(views)]
    parts = [found.observations(v, views[v].wand) for v, found in enumerate(matches)]
    shares = [len(found.row) / max(view.wand.seen.sum(), 1) for found, view in zip(matches, views, strict=True)]
    return BallObservations.joined(parts), np.array(shares)
