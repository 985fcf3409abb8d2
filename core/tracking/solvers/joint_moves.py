"""How far joints, and the tips of parts, move from one motion to another."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...body import part_poses
from ...body.kinematics import tip_positions
from ...body.motion import Motion
from ...numerics.arrays import Array
from .descent_stages import UNCONVERGED_MOVE
from .equations.problem import SegmentProblem


def farthest_joint(problem: SegmentProblem, before: Sequence[Motion], after: Sequence[Motion]) -> float:
    """Largest distance between the positions of a joint in two motions, over all frames and the performers that are
    solved for, metres.
    """
    return float(joint_moves(problem, before, after).max())


def joint_moves(problem: SegmentProblem, before: Sequence[Motion], after: Sequence[Motion]) -> Array:
    """The same distance on each frame, shape (F,)."""
    joints = [[part_poses(problem.bodies[i], m[i])[1] for m in (before, after)] for i in problem.sought]
    return np.max([np.linalg.norm(b - a, axis=-1).max(axis=1) for a, b in joints], axis=0)


def at_rest(problem: SegmentProblem, before: Sequence[Motion], after: Sequence[Motion], most: float) -> bool:
    """Whether from one motion to another no joint moves by so much, metres, nor the tip of any part by more than
    `UNCONVERGED_MOVE`: a hand may turn while all joints stay where they are. In a single view, which hardly shows how
    it turns, tips do not count: the more steps, the farther limbs drift in depth.
    """
    if farthest_joint(problem, before, after) >= most:
        return False
    if not problem.shows_depth:
        return True
    for i in problem.sought:
        body = problem.bodies[i]
        earlier, later = (tip_positions(body, part_poses(body, m[i])) for m in (before, after))
        if np.linalg.norm(later - earlier, axis=-1).max() >= UNCONVERGED_MOVE:
            return False
    return True
