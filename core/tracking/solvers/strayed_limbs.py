"""Limbs that a solution has led away from where keypoints had them.

Solving moves every joint a little. A limb that it moves by many times as much as the others follows something else in
the pictures, or keypoints that were wrong: only the evidence of both can tell.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ...body import part_poses
from ...body.kinematics import tip_positions
from ...body.limbs import limbs, without_end
from ...body.motion import Motion
from ...evidence.occlusion import intervals
from .descent_stages import SETTLED
from .gauss_newton import continued, descend
from .measurement import Workspace
from .problem import SegmentProblem, SegmentSolution
from .solution_ranking import better

STRAYED = 4.0
"""A limb has strayed where it is farther from the first pass than the performer's limbs usually are, so many times."""
LEAST = 0.05
"""Nearer than this it has not in any case, metres."""
BRIEF = 0.1
"""For how long, seconds: keypoints leap for single frames."""


def strayed_limbs(problem: SegmentProblem, performer: int, first_pass: Motion, found: Motion) -> list[list[int]]:
    """The limbs of a performer that are far from where the first pass had them, as chains of parts.

    Parameters
    ----------
    problem : SegmentProblem
    performer : int
    first_pass, found : Motion
        The performer's F poses there, and in a solution.
    """
    body = problem.bodies[performer]
    tips = [tip_positions(body, part_poses(body, motion)) for motion in (first_pass, found)]
    away = np.linalg.norm(tips[0] - tips[1], axis=-1)
    chains = [(chain, without_end(chain)) for chain in limbs(body)]
    if not chains:
        return []
    usual = float(np.median(np.concatenate([away[:, joints] for _, joints in chains], axis=1)))
    long = max(2, round(BRIEF * problem.fps))
    strayed = []
    for chain, joints in chains:
        far = away[:, joints].max(axis=1) > max(STRAYED * usual, LEAST)
        if any(last + 1 - first >= long for first, last in intervals(far)):
            strayed.append(chain)
    return strayed


def with_limbs_held(problem: SegmentProblem, performer: int, chains: Sequence[Sequence[int]]) -> SegmentProblem:
    """The problem with some limbs of a performer held as they are."""
    fixed = [f.copy() for f in problem.fixed]
    for part in {part for chain in chains for part in chain}:
        fixed[performer][:, 3 + 3 * part : 6 + 3 * part] = True
    return replace(problem, fixed=tuple(fixed))


def with_limbs_returned(
    problem: SegmentProblem, start: Sequence[Motion], solution: SegmentSolution, workspace: Workspace
) -> SegmentSolution:
    """The solution, with limbs that have left the first pass brought back there where the evidence is for it.

    A limb is brought back and its performer solved from there. If that leads it away again, it is also held there while
    all else of the performer is solved.

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
        motions = (*solution.motions[:i], back, *solution.motions[i + 1 :])
        found = [descend(alone, motions, workspace, SETTLED)]
        if strayed_limbs(problem, i, start[i], found[0].motions[i]):
            found.append(descend(with_limbs_held(alone, i, strayed), motions, workspace, SETTLED))
        best = better(alone, solution, *found)
        solution = solution if best is solution else replace(continued(solution, best), only=problem.only)
    return solution
