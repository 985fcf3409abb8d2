"""Limbs that have strayed from the first pass, the motion fitted to keypoints alone.

Solving moves every joint a little from the first pass. A limb that moves many times farther than the others either
follows something else in the images, or the keypoints were wrong there: the evidence of both possibilities is compared.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ....body import part_poses
from ....body.kinematics import tip_positions
from ....body.limbs import limbs, without_end
from ....body.motion import Motion, with_motion
from ....numerics.frame_ranges import lasting
from ..assessment.solution_ranking import covering_most
from ..descent_stages import SETTLED
from ..equations.measurement import Workspace
from ..equations.problem import SegmentProblem, SegmentSolution
from ..gauss_newton import continued, descend

STRAYED_RATIO = 4.0
"""Ratio of a limb's distance from the first pass to the performer's median, from which on it has strayed."""
MIN_DISTANCE = 0.05
"""Smaller distances do not count, metres."""
MIN_DURATION = 0.1
"""Shorter intervals do not count, seconds: keypoints leap for single frames."""


def strayed_limbs(problem: SegmentProblem, performer: int, first_pass: Motion, found: Motion) -> list[list[int]]:
    """Find the limbs of a performer that a solution has moved far from the first pass, as chains of parts.

    Parameters
    ----------
    problem : SegmentProblem
    performer : int
    first_pass, found : Motion
        The performer's F poses in the first pass and in the solution.
    """
    body = problem.bodies[performer]
    tips = [tip_positions(body, part_poses(body, motion)) for motion in (first_pass, found)]
    away = np.linalg.norm(tips[0] - tips[1], axis=-1)
    chains = [(chain, without_end(chain)) for chain in limbs(body)]
    if not chains:
        return []
    usual = float(np.median(np.concatenate([away[:, joints] for _, joints in chains], axis=1)))
    long = max(2, round(MIN_DURATION * problem.fps))
    strayed = []
    for chain, joints in chains:
        far = away[:, joints].max(axis=1) > max(STRAYED_RATIO * usual, MIN_DISTANCE)
        if lasting(far, long).any():
            strayed.append(chain)
    return strayed


def with_limbs_held(problem: SegmentProblem, performer: int, chains: Sequence[Sequence[int]]) -> SegmentProblem:
    """Return the problem with some limbs of a performer fixed."""
    fixed = [f.copy() for f in problem.fixed]
    for part in {part for chain in chains for part in chain}:
        fixed[performer][:, 3 + 3 * part : 6 + 3 * part] = True
    return replace(problem, fixed=tuple(fixed))


def with_limbs_returned(
    problem: SegmentProblem, start: Sequence[Motion], solution: SegmentSolution, workspace: Workspace
) -> SegmentSolution:
    """Return limbs that have strayed to the first pass where the evidence favours it.

    The performer is solved again from the motion with its strayed limbs back in the first pass. If they stray again, it
    is also solved with these limbs fixed. The best of the solutions is taken.

    Parameters
    ----------
    problem : SegmentProblem
        With keypoints.
    start : sequence of Motion
        The first pass.
    solution : SegmentSolution
    workspace : Workspace
    """
    for i in problem.sought:
        strayed = strayed_limbs(problem, i, start[i], solution.motions[i])
        if not strayed:
            continue
        alone = problem.alone(i)
        back = solution.motions[i].with_parts([part for chain in strayed for part in chain], start[i])
        motions = with_motion(solution.motions, i, back)
        found = [descend(alone, motions, workspace, SETTLED)]
        if strayed_limbs(problem, i, start[i], found[0].motions[i]):
            found.append(descend(with_limbs_held(alone, i, strayed), motions, workspace, SETTLED))
        best = covering_most(alone, solution, *found)
        solution = solution if best is solution else replace(continued(solution, best), only=problem.only)
    return solution
