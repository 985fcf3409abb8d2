"""Collar bones that rise with the arms that are searched for.

A raised arm hangs on a shoulder that is some centimetres higher. With the shoulder left where it was, the arm's true
pose covers little of the arm in the picture where it is thin.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ....body.motion import Motion
from ....body.shoulder_rhythm import RISE, ShoulderRhythm, shoulder_rhythms
from ....numerics import rotations
from ....numerics.arrays import Array, Bools
from ..equations.problem import SegmentProblem


@dataclass(frozen=True, eq=False)
class RaisedShoulder:
    """The collar bone that an arm hangs on: above its present pose by the shoulder's rhythm, as the arm is above its
    own.

    Attributes
    ----------
    rhythm : ShoulderRhythm
    up : ndarray, shape (F, 3)
        The body's upward direction in the world.
    present : ndarray, shape (F,)
        How far up the arm points at present, -1 to 1.
    held : ndarray of bool, shape (F,)
        Frames on which a key pose holds the collar bone.
    """

    rhythm: ShoulderRhythm
    up: Array
    present: Array
    held: Bools

    @classmethod
    def of(cls, problem: SegmentProblem, performer: int, chain: Sequence[int], R_world: Array) -> RaisedShoulder | None:
        """Return the shoulder of a limb of a performer whose parts have world orientations (F, P, 3, 3).

        None for a leg, and with a single view, which hardly shows how high an arm is that points towards it.
        """
        body = problem.bodies[performer]
        for rhythm in shoulder_rhythms(body) if problem.shows_depth else ():
            if rhythm.arm == chain[0]:
                up = R_world[:, body.parents[rhythm.collar]] @ rhythm.up
                present = np.einsum("fa,fa->f", up, R_world[:, rhythm.arm, :, 1])
                return cls(rhythm, up, present, problem.fixed_axes(performer)[:, rhythm.collar].any(axis=1))
        return None

    def turns(self, frames: slice, along: Array) -> Array:
        """Turns of the collar bone in its own frame, (m, K, 3, 3), with the arm along K directions (m, K, 3) in the
        world.
        """
        higher = np.einsum("fa,fka->fk", self.up[frames], along) - self.present[frames, None]
        higher[self.held[frames]] = 0.0
        return np.asarray(rotations.exp(RISE * higher[..., None] * self.rhythm.raising))

    def raising(self, rest: Array, collar: Array, motion: Motion) -> Motion:
        """Return a motion with the collar bone raised, and the arm in the same orientation as before.

        Parameters
        ----------
        rest : ndarray, shape (3, 3)
            The arm's orientation at rest in the frame of the collar bone.
        collar : ndarray, shape (F, 3, 3)
            World orientations of the collar bone.
        motion : Motion
        """
        Q, arm = motion.rotations.copy(), self.rhythm.arm
        along = (collar @ rest @ Q[:, arm])[:, None, :, 1]
        turn = self.turns(slice(None), along)[:, 0]
        Q[:, self.rhythm.collar] = Q[:, self.rhythm.collar] @ turn
        Q[:, arm] = rest.T @ np.swapaxes(turn, -1, -2) @ rest @ Q[:, arm]
        return Motion(motion.translations, Q)
