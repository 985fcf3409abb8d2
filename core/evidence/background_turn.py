"""How a camera that is held in the hand turns, and how its lens zooms, by the background of its pictures.

Corners of the first picture's background are followed into the next ones, there and back, from where the camera's turn
in the picture before leads them. What stands still is displaced as if the camera had turned about its centre: the turn
that most corners agree with is the camera's, whatever else moves. Where a turn leaves out many corners that agree with
a turn and a zoom, the lens zooms: turns alone would then agree with corners here and there in one picture after
another, as if the camera turned. If it does so by 2 % or more, a turn and a zoom are found in every picture. Once
many of the corners are hidden, those of the present picture take their place, so that errors add up only where somebody
passes by.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from ..cameras.camera import Camera
from ..cameras.lens_turns import zooming
from ..numerics.arrays import Array, Bools
from .background_shift import MAX_ERROR, MIN_CORNERS, MIN_SHARE, background_corners, beside, followed

_ROUNDS = 6
"""How often the corners that agree with a turn are found again with the turn by which they agree."""
_MIN_EXTENT = 0.1
"""Share of the picture that these must enclose."""
_RENEWED_SHARE = 2 / 3
"""Share of the corners that agree below which others take their place."""
MIN_ZOOM = 0.02
"""Logarithm of the ratio of focal lengths from which a lens zooms."""
_START_ERROR = 4.0
"""Distance up to which a corner agrees at first, in terms of that in the end."""


def background_turns(
    pictures: Iterator[NDArray[np.uint8]], camera: Camera, performers: Callable[[int], Bools], calibrated: int = 0
) -> Array | None:
    """Return the turns, shape (N, 3, 3), from a camera's axes on the first of its pictures to those on each, which zoom
    if its lens does (`core.cameras.lens_turns`): NaN where the background does not tell, None if the first picture
    shows too few corners.

    Parameters
    ----------
    pictures : iterator of N ndarray of uint8, shape (h, w)
        Grey, without lens distortion.
    camera : Camera
        That of the pictures; its pose does not matter.
    performers : callable
        Returns where they roughly are, shape (h, w), in the picture of a number.
    calibrated : int
        Number of the picture on which the camera has its calibrated focal length.
    """
    source, origin = next(pictures), 0
    corners = background_corners(source, beside(performers(0)))
    if corners is None:
        return None
    present = _TurnedLens(np.eye(3), camera.matrix)
    views, every = list[_TurnedLens | None]([present]), list[_FollowedCorners]()
    for number, picture in enumerate(pictures, 1):
        since = views[origin] or present
        start = corners[:, 0].astype(float)
        there, kept = followed(source, picture, corners, present.pixels(since.rays(start)))
        every.append(_FollowedCorners(origin, since, start, there.astype(float), kept))
        found = every[-1].view(since)
        views.append(None if found is None else found[0])
        if found is None:
            continue
        present, agreeing = found
        if agreeing.mean() < _RENEWED_SHARE:
            renewed = background_corners(picture, beside(performers(number)))
            if renewed is not None:
                source, corners, origin = picture, renewed, number
    if any(view is not None and view.K is not camera.matrix for view in views):
        zoomed = _zoomed_views(every, camera.matrix, calibrated)
        focal = [view.K[0, 0] for view in zoomed if view is not None]
        if np.ptp(np.log(focal)) > MIN_ZOOM:
            return np.stack([_matrix(view, zoomed[0]) for view in zoomed])
    return np.stack([_matrix(view) for view in views])


def _zoomed_views(every: Sequence[_FollowedCorners], K: Array, calibrated: int) -> list[_TurnedLens | None]:
    """Return the views of a lens that zooms in all pictures; a camera's matrix is that on the calibrated one.

    Where no zoom is found in a picture whose corners took the place of others, its view is the one it had then:
    otherwise all pictures into which these were followed would be lost.
    """
    first = K
    for _ in range(2):  # the first round tells the focal length of the first picture
        views: list[_TurnedLens | None] = [_TurnedLens(np.eye(3), first)]
        for corners in every:
            earlier = replace(corners.since, K=corners.since.K @ zooming(first[0, 0] / K[0, 0]))
            found = corners.view(views[corners.origin] or earlier, zooms=True)
            views.append(None if found is None else found[0])
        known = [number for number, view in enumerate(views) if view is not None]
        nearest = views[min(known, key=lambda number: abs(number - calibrated))]
        if nearest is not None:
            first = K @ zooming(first[0, 0] / nearest.K[0, 0])
    return views


def _matrix(view: _TurnedLens | None, first: _TurnedLens | None = None) -> Array:
    """Return the turn, (3, 3), since the first view, with its zoom if this is given; NaN where it is not known."""
    if view is None:
        return np.full((3, 3), np.nan)
    return view.turn if first is None else zooming(view.K[0, 0] / first.K[0, 0]) @ view.turn


@dataclass(frozen=True, eq=False)
class _TurnedLens:
    """How a camera has turned since its first picture, (3, 3), and its matrix, in which a zoom changes the focal
    length.
    """

    turn: Array
    K: Array

    def rays(self, pixels: Array) -> Array:
        """Return the directions, of length 1, in the axes of the first picture, of pixels (n, 2); shape (n, 3)."""
        return np.asarray(_rays(pixels, self.K) @ self.turn)

    def pixels(self, rays: Array) -> Array:
        places = rays @ (self.K @ self.turn).T
        return np.asarray(places[:, :2] / places[:, 2:])

    def moved(self, rays: Array, there: Array, *, zooms: bool) -> _TurnedLens:
        """Return the same after the turn that leads rays (n, 3) to where they were found, (n, 2); if it zooms, that
        with the focal length of this view, and then another focal length.
        """
        turned = replace(self, turn=Rotation.align_vectors(_rays(there, self.K), rays)[0].as_matrix())
        if not zooms:
            return turned
        away, found = turned.pixels(rays) - self.K[:2, 2], there - self.K[:2, 2]
        factor = float(np.sum(away * found) / np.sum(away**2))
        return replace(turned, K=self.K @ zooming(factor))


@dataclass(frozen=True, eq=False)
class _FollowedCorners:
    """Corners of a picture's background that were followed into another one.

    Attributes
    ----------
    origin : int
        Number of the picture from which.
    since : _TurnedLens
        The view of that picture, as far as it was known then.
    start, there : ndarray, shape (n, 2)
        Where they lie in both, pixels.
    kept : ndarray of bool, shape (n,)
        Which were found there and back.
    """

    origin: int
    since: _TurnedLens
    start: Array
    there: Array
    kept: Bools

    def view(self, since: _TurnedLens, *, zooms: bool = False) -> tuple[_TurnedLens, Bools] | None:
        """Return the view from where most of the corners that were found are seen, and which agree with it; None if too
        few do. A zoom is only allowed for where a turn leaves out many, as a turn is more exact without, or if it is
        known that the lens zooms.
        """
        start, there, kept = self.start, self.there, self.kept
        if kept.sum() < MIN_CORNERS:
            return None
        similarity, inliers = cv2.estimateAffinePartial2D(start[kept], there[kept], ransacReprojThreshold=MAX_ERROR)
        if similarity is None:
            return None
        rays, first, many = since.rays(start), kept.copy(), _RENEWED_SHARE * kept.sum()
        first[kept] = inliers[:, 0] > 0
        present, chosen = _agreeing(rays, there, kept, first, since, zooms=zooms)
        if chosen.sum() < many and not zooms:
            zoomed, explained = _agreeing(rays, there, kept, first, since, zooms=True)
            if explained.sum() >= many:
                present, chosen = zoomed, explained
        if chosen.sum() < max(MIN_CORNERS, MIN_SHARE * kept.sum()):
            return None
        hull = cv2.contourArea(cv2.convexHull(start[chosen].astype(np.float32)))
        return (present, chosen) if hull > _MIN_EXTENT * 4 * since.K[0, 2] * since.K[1, 2] else None


def _agreeing(
    rays: Array, there: Array, kept: Bools, chosen: Bools, view: _TurnedLens, *, zooms: bool
) -> tuple[_TurnedLens, Bools]:
    """Return the view that most of the kept ones among n corners agree with, and which do, from some that may; no
    corner agrees if too few did on the way.
    """
    for limit in MAX_ERROR * np.geomspace(_START_ERROR, 1.0, _ROUNDS):
        if chosen.sum() < MIN_CORNERS:
            return view, np.zeros_like(kept)
        view = view.moved(rays[chosen], there[chosen], zooms=zooms)
        chosen = kept & (np.linalg.norm(view.pixels(rays) - there, axis=1) < limit)
    return view, chosen


def _rays(pixels: Array, K: Array) -> Array:
    """Return the directions, of length 1, in which a camera sees pixels (n, 2); shape (n, 3)."""
    rays = np.column_stack([pixels, np.ones(len(pixels))]) @ np.linalg.inv(K).T
    return np.asarray(rays / np.linalg.norm(rays, axis=1, keepdims=True))
