"""Trunk and collar bones between key poses.

Their outlines run along the body, and clothes move over them: pictures show little of how a bend is shared between
them, and lead them astray together. Parts that usually stay near their rest orientation therefore stay near the curve
through the key poses.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from ...body.joint_limits import habitual_prior
from ...body.motion import Motion
from ...numerics.arrays import Array
from ...numerics.banded_blocks import BandedBlocks
from .problem import SegmentProblem

ON_A_FRAME = 1 / 3
"""Usual departure from the curve on a frame, as a share of that of a whole motion from rest."""


def with_curves(
    problem: SegmentProblem, systems: list[BandedBlocks], motions: tuple[Motion, ...]
) -> list[BandedBlocks]:
    """Normal equations of every performer with those of its stiff parts (`Body.is_stiff`) that leave the curve.

    Parameters
    ----------
    problem : SegmentProblem
    systems : list of BandedBlocks
        Per performer.
    motions : tuple of Motion
        F poses per performer; where parts are fixed, they are key poses.
    """
    found = list(systems)
    for i in problem.sought:
        if problem.bodies[i].is_stiff.any():
            found[i] = systems[i] + near_curve(problem, i, motions[i])
    return found


def near_curve(problem: SegmentProblem, performer: int, motion: Motion) -> BandedBlocks:
    """Normal equations of the departures of one performer's stiff parts from the curve through their key poses.

    The curve turns steadily from one key pose to the next. Before the first and after the last it is that key pose, and
    without any the rest orientation.
    """
    body, F = problem.bodies[performer], len(motion)
    fixed = problem.fixed[performer][:, 3:].reshape(F, -1, 3).all(axis=2)
    curve: Array = np.tile(np.eye(3), (F, len(body), 1, 1))
    precision = np.zeros((F, len(body)))
    frames = np.arange(F)
    for part in np.flatnonzero(body.is_stiff):
        keys = np.flatnonzero(fixed[:, part])
        if len(keys):
            curve[:, part] = motion.rotations[keys[np.abs(frames[:, None] - keys).argmin(axis=1)], part]
        if len(keys) > 1:
            inside = frames[keys[0] : keys[-1] + 1]
            curve[inside, part] = Slerp(keys, Rotation.from_matrix(motion.rotations[keys, part]))(inside).as_matrix()
        precision[:, part] = 1 / (ON_A_FRAME * body.departures[part]) ** 2
    return habitual_prior(motion, precision, curve)
