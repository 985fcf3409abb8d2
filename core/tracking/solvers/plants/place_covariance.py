"""How surely the normal equations know the places of points of a performer.

All points of a part move with it: the covariance of the part's twists, its displacements and rotations, gives that of
any of them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from ....numerics import rotations
from ....numerics.arrays import Array
from ....numerics.banded import BandedFactor

FRAMES_AT_ONCE = 8
"""Number of frames whose covariances with all others are computed at a time: each takes six solutions of the whole
system, which are large on a long segment."""

LONG = 200
"""Number of frames of a segment from which on frames count as known that are at least `REACH` frames after those whose
places are asked for: time and memory would grow with the square of the length."""
REACH = 50
KNOWN_EVERY = 100
"""Frames between those from which on all may count as known."""


@dataclass(frozen=True, eq=False)
class TwistCovariance:
    """The covariance between the twists of a part about its origin on F frames, by the normal equations.

    Attributes
    ----------
    factor : BandedFactor
        Of the normal equations of all members.
    own : slice
        Their degrees of freedom that belong to the part's performer.
    jacobian : ndarray, shape (F, 6, D)
        Derivatives by these of the displacement of the part's origin and of its rotation, metres and radians.
    step : ndarray, shape (F, 6)
        Twists to the least cost.
    columns : dict of tuple of int to tuple of int and ndarray, shape (n, 6, 6)
        Covariances of n twists with that on one frame, and the frame of the first of them, by the first frame that
        counts as known and that frame; those that were asked for so far.
    """

    factor: BandedFactor
    own: slice
    jacobian: Array
    step: Array
    columns: dict[tuple[int, int], tuple[int, Array]] = field(default_factory=dict)

    def solve(self, frames: Sequence[int], known: int) -> None:
        """Compute the columns of these frames where all from `known` on count as known."""
        asked = [frame for frame in frames if (known, frame) not in self.columns]
        for begin in range(0, len(asked), FRAMES_AT_ONCE):
            self._solve(asked[begin : begin + FRAMES_AT_ONCE], known)

    def _solve(self, frames: list[int], known: int) -> None:
        begin = frames[0]  # covariances with those before follow by symmetry
        factor = self.factor.between(begin, known)
        right = np.zeros((*factor.free.shape, len(frames), 6))
        for k, frame in enumerate(frames):
            right[frame - begin, self.own, k] = self.jacobian[frame].T
        solved = factor.solve(right.reshape(*right.shape[:2], -1))[:, self.own]
        found = (self.jacobian[begin:known] @ solved).reshape(len(right), 6, len(frames), 6)
        self.columns.update({(known, frame): (begin, found[:, :, k].copy()) for k, frame in enumerate(frames)})


@dataclass(frozen=True, eq=False)
class PlaceCovariance:
    """The covariance between the places of a point of a part on F frames, by the normal equations.

    Attributes
    ----------
    twists : TwistCovariance
        Of the part.
    places : ndarray, shape (F, 3)
        Where the point is at the least cost.
    rows : ndarray, shape (F, 3, 6)
        Derivatives of the places by the twists.
    columns : dict of tuple of int to tuple of int and ndarray, shape (n, 3, 3)
        Covariances of places, as those of twists.
    """

    twists: TwistCovariance
    places: Array
    rows: Array
    columns: dict[tuple[int, int], tuple[int, Array]] = field(default_factory=dict)

    @classmethod
    def of(cls, twists: TwistCovariance, points: Array, arms: Array) -> PlaceCovariance:
        """Make it of where a point was tracked, and of its distances from the part's origin, both (F, 3)."""
        rows = np.concatenate([np.broadcast_to(np.eye(3), (len(arms), 3, 3)), -rotations.skew(arms)], axis=2)
        return cls(twists, points + (rows @ twists.step[..., None])[..., 0], rows)

    def steps(self, first: int, last: int) -> tuple[Array, Array]:
        """Return the steps `first` to `last` from each frame to the next, (3 n,), and their covariance."""
        frames, known = range(first, last + 2), self._known_from(last + 2)
        self.twists.solve(frames, known)
        between = np.zeros((len(frames), 3, len(frames), 3))
        for k, frame in enumerate(frames):
            begin, column = self._column(frame, known)
            low = max(begin, first)
            between[low - first :, :, k] = column[low - begin : last + 2 - begin]
            between[: low - first, :, k] = between[k, :, : low - first].transpose(1, 2, 0)  # of the frames before
        covariance = np.diff(np.diff(between, axis=0), axis=2)
        steps = np.diff(self.places[first : last + 2], axis=0).ravel()
        return steps, covariance.reshape(len(steps), len(steps))

    def _column(self, frame: int, known: int) -> tuple[int, Array]:
        if (known, frame) not in self.columns:
            begin, column = self.twists.columns[known, frame]
            own = self.rows[begin:known] @ column @ self.rows[frame].T
            self.columns[known, frame] = begin, own
        return self.columns[known, frame]

    def _known_from(self, stop: int) -> int:
        """Return the frame from which on all count as known where places before `stop` are asked for. It is the same
        for most of them, so that their covariances are those of one system.
        """
        F = len(self.places)
        return F if F <= LONG else min(-(-(stop + REACH) // KNOWN_EVERY) * KNOWN_EVERY, F)
