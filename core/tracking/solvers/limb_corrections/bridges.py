"""Leading limbs evenly from one frame to another, across frames on which they leap."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from ....body.motion import Motion
from ....numerics import rotations
from ....numerics.arrays import Bools
from ..descent_stages import SETTLED, SETTLING
from ..equations.problem import SegmentProblem

LEAP_RATIO = 6.0
"""Smallest ratio of the acceleration at a leap to the limb's median acceleration."""
BRIDGING = (*SETTLING, *SETTLED, *SETTLED)
"""From a straight path to the solution. The rest of the body must converge again as far as before, or its residuals
outweigh those of the limb."""


@dataclass(frozen=True)
class Leap:
    """An interval in which limbs are away.

    Attributes
    ----------
    first, last : int
        First and last of its frames.
    parts : tuple of int
        Indices of the parts of all limbs that leap there.
    """

    first: int
    last: int
    parts: tuple[int, ...]


def bridged_motion(motion: Motion, leap: Leap, fixed: Bools) -> Motion:
    """Turn the limbs evenly from the frame before a leap to the one after it, except for what is fixed (F, D).

    Where the motion ends with the leap, the limbs stand still.
    """
    parts, Q = list(leap.parts), motion.rotations.copy()
    begin, end = leap.first - 1, leap.last + 1
    before, after = Q[begin if begin >= 0 else end, parts], Q[end if end < len(Q) else begin, parts]
    turn = rotations.log(np.swapaxes(before, -1, -2) @ after)
    share = np.linspace(0, 1, leap.last - leap.first + 3)[1:-1, None, None]
    frames = np.arange(leap.first, leap.last + 1)
    kept = fixed[frames, 3:].reshape(len(frames), -1, 3)[:, parts].any(axis=2)[..., None, None]
    Q[frames[:, None], parts] = np.where(kept, Q[frames[:, None], parts], before @ rotations.exp(share * turn))
    return Motion(motion.translations, Q)


def evenly_led(
    problem: SegmentProblem, performer: int, motion: Motion, chain: Sequence[int], *, beyond: bool = False
) -> Motion:
    """Turn a limb evenly from each frame on which key poses hold all of it to the next.

    Parameters
    ----------
    problem : SegmentProblem
    performer : int
    motion : Motion
        F poses.
    chain : sequence of int
        The limb's parts.
    beyond : bool
        Whether it has the turn of the first of these frames before it, too, and that of the last after it; otherwise
        the motion there is left as it is.
    """
    held = np.flatnonzero(problem.fixed_axes(performer)[:, list(chain)].all(axis=(1, 2))).tolist()
    for a, b in pairwise([-1, *held, len(motion)] if held and beyond else held):
        if b > a + 1:
            motion = bridged_motion(motion, Leap(a + 1, b - 1, tuple(chain)), problem.fixed[performer])
    return motion
