"""Whether keypoints are numbered as the pictures that they were found in.

From one picture to another, what is seen at a joint moves as its keypoint does if the keypoint belongs to these
pictures. So the movements of keypoints are compared with those that the pictures show at their places, also in
pictures that are some frames earlier or later (pyramidal Lucas-Kanade, as in `core.evidence.background_shift`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from ..numerics.arrays import Array, Ints

MAX_FRAMES_OFF = 3
"""Numbers of keypoints are tried that are up to this much too high or too low."""
ENOUGH_MOVEMENTS = 400
"""Number of movements in a view after which no more are compared."""
MIN_FRAMES_OFF, MIN_SURENESS = 0.75, 2.5
"""Least number of frames that is reported, and in standard deviations how much better pictures so much earlier or later
must agree; see docs/keypoints.md for what is measured with right and with wrong numbers."""
_FRAMES_OFF = np.arange(-MAX_FRAMES_OFF, MAX_FRAMES_OFF + 1)
_MIN_MOVE, _MAX_DISTANCE = 1.5 / 480, 8.0 / 480
"""Least movement that is compared, and distance between two movements from which on they disagree, as shares of the
longer side of a picture."""
_WINDOW, _LEVELS = (15, 15), 3


@dataclass(frozen=True, eq=False)
class KeypointMovements:
    """How well movements of L keypoints agree with those in pictures that are earlier or later by D numbers of frames.

    Attributes
    ----------
    distances : ndarray, shape (L, D)
        Sums of the distances between the two, shares of the longer side of a picture.
    counts : ndarray of int, shape (L,)
        How many movements were compared.
    """

    distances: Array
    counts: Ints

    def joined(self, other: KeypointMovements) -> KeypointMovements:
        """Return the sums of both."""
        return KeypointMovements(self.distances + other.distances, self.counts + other.counts)


def keypoint_movements(grey: NDArray[np.uint8], places: Array) -> KeypointMovements:
    """Compare the movements of keypoints with those in pictures of the same frames and of earlier and later ones.

    Parameters
    ----------
    grey : ndarray of uint8, shape (N, h, w)
        Consecutive frames of a view.
    places : ndarray, shape (N, L, 2)
        Pixels of the keypoints that have these frames' numbers; NaN where one was not found.
    """
    N, L = places.shape[:2]
    side = max(grey.shape[1:])
    distances = np.full((N, L, len(_FRAMES_OFF)), np.nan)
    moves = np.full(places.shape, np.nan)
    moves[1:-1] = places[2:] - places[:-2]
    moving = np.linalg.norm(np.nan_to_num(moves), axis=-1) > _MIN_MOVE * side
    moving[: MAX_FRAMES_OFF + 1] = moving[max(N - MAX_FRAMES_OFF - 1, 0) :] = False
    for shown in range(1, N - 1):
        frames = shown - _FRAMES_OFF
        inside = np.flatnonzero((frames >= 1) & (frames < N - 1))
        which, joints = np.nonzero(moving[frames[inside]])
        if not len(which):
            continue
        own = frames[inside][which]
        start = places[own - 1, joints].astype(np.float32)[:, None]
        end, found, _ = cv2.calcOpticalFlowPyrLK(
            grey[shown - 1], grey[shown + 1], start, None, winSize=_WINDOW, maxLevel=_LEVELS
        )
        apart = np.linalg.norm((end - start)[:, 0] - moves[own, joints], axis=-1) / side
        apart[found[:, 0] == 0] = np.nan
        distances[own, joints, inside[which]] = np.minimum(apart, _MAX_DISTANCE)
    compared = np.isfinite(distances).all(axis=-1)
    return KeypointMovements(np.where(compared[..., None], distances, 0.0).sum(axis=0), compared.sum(axis=0))


def frames_off_by_view(views: Sequence[Sequence[KeypointMovements]]) -> tuple[float | None, ...]:
    """Return, per view, what `frames_off` says of the performers in all views together or, where that is nothing, of
    those in the view alone; None for a view without keypoints.
    """
    common = frames_off([own for view in views for own in view])
    return tuple((common or frames_off(view)) if view else None for view in views)


def frames_off(found: Sequence[KeypointMovements]) -> float | None:
    """Return by how many frames the pictures that keypoints belong to are later than those of the same numbers:
    negative if the keypoints' numbers are too high. None if that is less than `MIN_FRAMES_OFF`, or unclear.

    How sure it is follows from the scatter between keypoints (jackknife).
    """
    own = np.concatenate([np.zeros((0, len(_FRAMES_OFF))), *(one.distances for one in found)])
    total = own.sum(axis=0)
    best = int(np.argmin(total))
    if best == MAX_FRAMES_OFF or len(own) < 2:
        return None
    gain = own[:, MAX_FRAMES_OFF] - own[:, best]
    sure = gain.sum() / max(np.sqrt(len(gain) * np.var(gain, ddof=1)), 1e-9)
    off = float(_FRAMES_OFF[best])
    if 0 < best < len(total) - 1:  # the vertex of the parabola through three sums
        before, least, after = total[best - 1 : best + 2]
        off += float(0.5 * (before - after) / (before - 2 * least + after))
    return off if sure > MIN_SURENESS and abs(off) >= MIN_FRAMES_OFF else None
