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
"""Number of frames of a segment from which on places count as independent that are more than `REACH` frames apart, and
frames farther ahead as known: time and memory would grow with the square of the length."""
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
    columns : dict of int to tuple of int and ndarray, shape (n, 3, 3)
        Covariances of n places with that on one frame, by its number, and the frame of the first of them; those that
        were asked for so far.
    """

    factor: BandedFactor
    own: slice
    jacobian: Array
    places: Array
    columns: dict[int, tuple[int, Array]] = field(default_factory=dict)

    def steps(self, first: int, last: int) -> tuple[Array, Array]:
        """Return the steps `first` to `last` from each frame to the next, (3 n,), and their covariance."""
        frames = slice(first, last + 2)
        asked = [frame for frame in range(first, last + 2) if frame not in self.columns]
        for begin in range(0, len(asked), FRAMES_AT_ONCE):
            self._solve(asked[begin : begin + FRAMES_AT_ONCE])
        between = np.zeros((last + 2 - first, 3, last + 2 - first, 3))
        for k in range(len(between)):
            begin, column = self.columns[first + k]
            low, high = max(begin, first), min(begin + len(column), last + 2)
            between[low - first : high - first, :, k] = column[low - begin : high - begin]
        covariance = np.diff(np.diff(between, axis=0), axis=2)
        steps = np.diff(self.places[frames], axis=0).ravel()
        return steps, covariance.reshape(len(steps), len(steps))

    def _solve(self, frames: list[int]) -> None:
        F = len(self.places)
        begin, end = (0, F) if F <= LONG else (max(frames[0] - REACH, 0), min(frames[-1] + 1 + REACH, F))
        factor = self.factor.between(begin, end)
        right = np.zeros((*factor.free.shape, len(frames), 3))
        for k, frame in enumerate(frames):
            right[frame - begin, self.own, k] = self.jacobian[frame].T
        solved = factor.solve(right.reshape(*right.shape[:2], -1))[:, self.own]
        found = (self.jacobian[begin:end] @ solved).reshape(len(right), 3, len(frames), 3)
        self.columns.update({frame: (begin, found[:, :, k].copy()) for k, frame in enumerate(frames)})
