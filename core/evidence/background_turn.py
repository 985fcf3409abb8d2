"""How a camera that is held in the hand turns, by the background of its pictures.

Corners of the first picture's background are followed into the next ones, there and back, from where the camera's turn
in the picture before leads them. What stands still is displaced as if the camera had turned about its centre: the turn
that most corners agree with is the camera's, whatever else moves. Once many of the corners are hidden, those of the
present picture take their place, so that errors add up only where somebody passes by.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from ..cameras.camera import Camera
from ..numerics.arrays import Array, Bools
from .background_shift import MAX_ERROR, MIN_CORNERS, MIN_SHARE, background_corners, beside, followed

_ROUNDS = 6
"""How often the corners that agree with a turn are found again with the turn by which they agree."""
_MIN_EXTENT = 0.1
"""Share of the picture that these must enclose."""
_RENEWED_SHARE = 2 / 3
"""Share of the corners that agree below which others take their place."""
_START_ERROR = 4.0
"""Distance up to which a corner agrees at first, in terms of that in the end."""


def background_turns(
    pictures: Iterator[NDArray[np.uint8]], camera: Camera, performers: Callable[[int], Bools]
) -> Array | None:
    """Return the rotations, shape (N, 3, 3), from a camera's axes on the first of its pictures to those on each: NaN
    where the background does not tell, None if the first picture shows too few corners.

    Parameters
    ----------
    pictures : iterator of N ndarray of uint8, shape (h, w)
        Grey, without lens distortion.
    camera : Camera
        That of the pictures; its pose does not matter.
    performers : callable
        Returns where they roughly are, shape (h, w), in the picture of a number.
    """
    K = camera.matrix
    source = next(pictures)
    corners = background_corners(source, beside(performers(0)))
    if corners is None:
        return None
    since, turn, turns = np.eye(3), np.eye(3), [np.eye(3)]
    for number, picture in enumerate(pictures, 1):
        start = corners[:, 0].astype(float)
        there, kept = followed(source, picture, corners, _pixels(_rays(start, K) @ (turn @ since.T).T, K))
        found = _turn(start, there.astype(float), kept, K)
        if found is None:
            turns.append(np.full((3, 3), np.nan))
            continue
        turn = found[0] @ since
        turns.append(turn)
        if found[1].mean() < _RENEWED_SHARE:
            renewed = background_corners(picture, beside(performers(number)))
            if renewed is not None:
                source, corners, since = picture, renewed, turn
    return np.stack(turns)


def _turn(start: Array, there: Array, kept: Bools, K: Array) -> tuple[Array, Bools] | None:
    """Return the turn that most of the corners (n, 2) that were found agree with, and which do; None if too few do."""
    if kept.sum() < MIN_CORNERS:
        return None
    rays, others = _rays(start, K), _rays(there, K)
    similarity, agreeing = cv2.estimateAffinePartial2D(start[kept], there[kept], ransacReprojThreshold=MAX_ERROR)
    if similarity is None:
        return None
    turn, chosen = np.eye(3), kept.copy()
    chosen[kept] = agreeing[:, 0] > 0
    for limit in MAX_ERROR * np.geomspace(_START_ERROR, 1.0, _ROUNDS):
        if chosen.sum() < MIN_CORNERS:
            return None
        turn = Rotation.align_vectors(others[chosen], rays[chosen])[0].as_matrix()
        chosen = kept & (np.linalg.norm(_pixels(rays @ turn.T, K) - there, axis=1) < limit)
    if chosen.sum() < max(MIN_CORNERS, MIN_SHARE * kept.sum()):
        return None
    hull = cv2.contourArea(cv2.convexHull(start[chosen].astype(np.float32)))
    return (turn, chosen) if hull > _MIN_EXTENT * 4 * K[0, 2] * K[1, 2] else None


def _rays(pixels: Array, K: Array) -> Array:
    """Return the directions, of length 1, in which a camera sees pixels (n, 2); shape (n, 3)."""
    rays = np.column_stack([pixels, np.ones(len(pixels))]) @ np.linalg.inv(K).T
    return np.asarray(rays / np.linalg.norm(rays, axis=1, keepdims=True))


def _pixels(rays: Array, K: Array) -> Array:
    places = rays @ K.T
    return np.asarray(places[:, :2] / places[:, 2:])
