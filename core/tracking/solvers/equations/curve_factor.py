"""A prior on stiff parts, the trunk and the collar bones: they stay near the curve through their key poses.

Images hardly show how a bend is shared between these parts, as their outlines run along the body and clothes move over
them, and all of them may go astray together.
"""

from __future__ import annotations

import numpy as np

from ....body.joint_limits import habitual_prior
from ....body.motion import Motion
from ....numerics import rotations
from ....numerics.arrays import Array
from ....numerics.banded_blocks import BandedBlocks
from .problem import SegmentProblem

FRAME_SIGMA_RATIO = 1 / 3
"""Usual departure from the curve on a frame, relative to the part's usual departure from its rest orientation."""


def with_curves(
    problem: SegmentProblem, systems: list[BandedBlocks], motions: tuple[Motion, ...]
) -> list[BandedBlocks]:
    """Add the prior on stiff parts (`Body.is_stiff`) to the normal equations of the performers that are solved for.

    Parameters
    ----------
    problem : SegmentProblem
    systems : list of BandedBlocks
        One per performer.
    motions : tuple of Motion
        F poses per performer; where parts are fixed, these are key poses.
    """
    found = list(systems)
    for i in problem.sought:
        if problem.bodies[i].is_stiff.any():
            found[i] = systems[i] + near_curve(problem, i, motions[i])
    return found


def near_curve(problem: SegmentProblem, performer: int, motion: Motion) -> BandedBlocks:
    """Build the normal equations of the departures of one performer's stiff parts from the curve.

    The curve turns at a constant rate from one key pose to the next (slerp). Before the first key pose and after the
    last one it stays there; without any key pose it is the rest orientation.
    """
    body, F = problem.bodies[performer], len(motion)
    fixed = problem.fixed[performer][:, 3:].reshape(F, -1, 3).all(axis=2)
    curve: Array = np.tile(np.eye(3), (F, len(body), 1, 1))
    precision = np.zeros((F, len(body)))
    frames = np.arange(F)
    for part in np.flatnonzero(body.is_stiff):
        keys = np.flatnonzero(fixed[:, part])
        known = motion.rotations[keys, part]
        if len(keys) == 1:
            curve[:, part] = known
        elif len(keys):
            last = np.clip(np.searchsorted(keys, frames, side="right") - 1, 0, len(keys) - 2)
            share = np.clip((frames - keys[last]) / np.diff(keys)[last], 0, 1)
            turns = rotations.log(np.swapaxes(known[:-1], -1, -2) @ known[1:])
            curve[:, part] = known[last] @ rotations.exp(share[:, None] * turns[last])
        precision[:, part] = 1 / (FRAME_SIGMA_RATIO * body.departures[part]) ** 2
    return habitual_prior(motion, precision, curve)
