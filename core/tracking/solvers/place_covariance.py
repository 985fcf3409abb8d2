"""How surely the normal equations know the places of a point of a performer."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from ...numerics.arrays import Array
from ...numerics.banded import BandedFactor

FRAMES_AT_ONCE = 16
"""Number of frames whose covariances with all others are computed at a time: each takes three solutions of the whole
system, which are large on a long segment."""


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
    columns : dict of int to ndarray, shape (F, 3, 3)
        Covariances of all places with that on one frame, by its number; those that were asked for so far.
    """

    factor: BandedFactor
    own: slice
    jacobian: Array
    places: Array
    columns: dict[int, Array] = field(default_factory=dict)

    def steps(self, first: int, last: int) -> tuple[Array, Array]:
        """Return the steps `first` to `last` from each frame to the next, (3 n,), and their covariance."""
        frames = slice(first, last + 2)
        asked = [frame for frame in range(first, last + 2) if frame not in self.columns]
        for begin in range(0, len(asked), FRAMES_AT_ONCE):
            self._solve(asked[begin : begin + FRAMES_AT_ONCE])
        between = np.stack([self.columns[frame][frames] for frame in range(first, last + 2)], axis=2)
        covariance = np.diff(np.diff(between, axis=0), axis=2)
        steps = np.diff(self.places[frames], axis=0).ravel()
        return steps, covariance.reshape(len(steps), len(steps))

    def _solve(self, frames: list[int]) -> None:
        right = np.zeros((*self.factor.free.shape, len(frames), 3))
        for k, frame in enumerate(frames):
            right[frame, self.own, k] = self.jacobian[frame].T
        solved = self.factor.solve(right.reshape(*right.shape[:2], -1))[:, self.own]
        found = (self.jacobian @ solved).reshape(len(right), 3, len(frames), 3)
        self.columns.update({frame: found[:, :, k] for k, frame in enumerate(frames)})
