"""How surely the normal equations know the places of a point of a performer."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from ...numerics.arrays import Array
from ...numerics.banded import BandedFactor

FRAMES_AT_ONCE = 16
"""Number of frames whose covariances with all others are computed at a time: each takes three solutions of the whole
system, which are large on a long segment."""

LONG = 200
"""Number of frames of a segment from which on frames count as known that are at least `REACH` frames after those whose
places are asked for: time and memory would grow with the square of the length."""
REACH = 50


@dataclass(frozen=True, eq=False)
class PlaceCovariance:
    """The covariance between the places of a point of the soles on F frames, by the normal equations.

    Attributes
    ----------
    factor : BandedFactor
        Of the normal equations of all members.
    own : slice
        Their degrees of freedom that belong to the point's performer.
    jacobian : ndarray, shape (F, 3, D)
        Derivatives of the places by these.
    places : ndarray, shape (F, 3)
        Where the point is at the least cost.
    columns : dict of tuple of int to tuple of int and ndarray, shape (n, 3, 3)
        Covariances of n places with that on one frame, and the frame of the first of them, by the first frame that
        counts as known and that frame; those that were asked for so far.
    """

    factor: BandedFactor
    own: slice
    jacobian: Array
    places: Array
    columns: dict[tuple[int, int], tuple[int, Array]] = field(default_factory=dict)

    def steps(self, first: int, last: int) -> tuple[Array, Array]:
        """Return the steps `first` to `last` from each frame to the next, (3 n,), and their covariance."""
        frames, known = range(first, last + 2), self._known_from(last + 2)
        asked = [frame for frame in frames if (known, frame) not in self.columns]
        for begin in range(0, len(asked), FRAMES_AT_ONCE):
            self._solve(asked[begin : begin + FRAMES_AT_ONCE], known)
        between = np.zeros((len(frames), 3, len(frames), 3))
        for k, frame in enumerate(frames):
            begin, column = self.columns[known, frame]
            low = max(begin, first)
            between[low - first :, :, k] = column[low - begin : last + 2 - begin]
            between[: low - first, :, k] = between[k, :, : low - first].transpose(1, 2, 0)  # of the frames before
        covariance = np.diff(np.diff(between, axis=0), axis=2)
        steps = np.diff(self.places[first : last + 2], axis=0).ravel()
        return steps, covariance.reshape(len(steps), len(steps))

    def _known_from(self, stop: int) -> int:
        """Return the frame from which on all count as known where places before `stop` are asked for. It is the same
        for most of them, so that their covariances are those of one system.
        """
        F = len(self.places)
        return F if F <= LONG else min(-(-(stop + REACH) // LONG) * LONG, F)

    def _solve(self, frames: list[int], known: int) -> None:
        begin = 0 if len(self.places) <= LONG else frames[0]  # those before follow by symmetry
        factor = self.factor.between(begin, known)
        right = np.zeros((*factor.free.shape, len(frames), 3))
        for k, frame in enumerate(frames):
            right[frame - begin, self.own, k] = self.jacobian[frame].T
        solved = factor.solve(right.reshape(*right.shape[:2], -1))[:, self.own]
        found = (self.jacobian[begin:known] @ solved).reshape(len(right), 3, len(frames), 3)
        self.columns.update({(known, frame): (begin, found[:, :, k].copy()) for k, frame in enumerate(frames)})
