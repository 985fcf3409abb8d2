"""Knees and elbows turned about the line through both ends of their limb.

Hip and ankle may be right, and the knee between them some centimetres aside. That is a minimum of its own if other
parts have given way to it, as the pelvis does, too far from the true one for a descent. A search does not find it
either: what it finds within a descent's reach counts as where the limb was.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ....body import Body, part_poses
from ....body.kinematics import motion_of_poses
from ....body.limbs import limbs
from ....body.motion import Motion
from ....numerics import rotations
from ....numerics.arrays import Array, Bools
from ..assessment.settled_solutions import SettledSolutions
from ..descent_stages import OUTLINE_REACH
from ..equations.measurement import Workspace
from ..equations.problem import SegmentProblem, SegmentSolution
from .limb_groups import continued_where_likelier, solved_from
from .local_trials import ADAPTATION_TIME


def with_limbs_swivelled(
    problem: SegmentProblem, solution: SegmentSolution, known: SettledSolutions, workspace: Workspace
) -> SegmentSolution:
    """Turn each limb of a single performer about its ends, either way, so far that its middle joint moves as far as a
    descent reaches, solve from there, and return the likeliest solution, which may be the given one.

    Parameters
    ----------
    problem : SegmentProblem
    solution : SegmentSolution
    known : SettledSolutions
    workspace : Workspace
    """
    [body] = problem.bodies
    for chain in (limb for limb in limbs(body) if len(limb) > 2):
        for way in (1.0, -1.0):
            first = known.after(problem, solution, workspace)
            motion = swivelled(body, first.solution.motions[0], chain, way * _rise(problem), problem.fixed[0])
            found = solved_from(problem, (motion,), first.noise, workspace)
            solution = continued_where_likelier(problem, solution, first, found, workspace)
    return solution


def swivelled(body: Body, motion: Motion, chain: Sequence[int], share: Array, fixed: Bools) -> Motion:
    """Turn the first two parts of a limb about the line from its first joint to its third, which stay in place.

    Parameters
    ----------
    body : Body
    motion : Motion
        F poses.
    chain : sequence of int
        The limb's parts.
    share : ndarray, shape (F,)
        How far the joint between the two parts moves along its circle, in units of `OUTLINE_REACH`; of a limb that is
        nearly straight, less.
    fixed : ndarray of bool, shape (F, D)
        Degrees of freedom that stay: parts with any of them are not turned.
    """
    R, T = part_poses(body, motion)
    begin, middle, end = (T[:, part] for part in chain[:3])
    axis = (end - begin) / np.maximum(np.linalg.norm(end - begin, axis=1, keepdims=True), 1e-9)
    aside = np.linalg.norm(np.cross(axis, middle - begin), axis=1)
    turn = rotations.exp((share * OUTLINE_REACH / np.maximum(aside, OUTLINE_REACH))[:, None] * axis)
    for part in chain[:2]:
        R[:, part] = turn @ R[:, part]
    moved, Q, parts = motion_of_poses(body, (R, T)), motion.rotations.copy(), list(chain)
    kept = fixed[:, 3:].reshape(len(Q), -1, 3)[:, parts].any(axis=2)[..., None, None]
    Q[:, parts] = np.where(kept, Q[:, parts], moved.rotations[:, parts])
    return Motion(motion.translations, Q)


def _rise(problem: SegmentProblem) -> Array:
    """From 0 on the frames of whole key poses to 1 where the motion may have adapted to a change, shape (F,)."""
    keys, seconds = problem.whole_keys(0), problem.times / problem.fps
    if not len(keys):
        return np.ones(problem.length)
    apart = np.abs(seconds[:, None] - seconds[keys]).min(axis=1)
    return np.asarray(np.minimum(apart / ADAPTATION_TIME, 1.0))
