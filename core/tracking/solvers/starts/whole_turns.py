"""A start in which the whole body turns once more, or the other way round, between two key poses.

The curve through the key poses takes the shorter way from each to the next, so that a spin by nearly a turn passes for
standing still. The start with the other way is the same curve with a whole turn about one of the pelvis's axes added:
upright a spin, sideways a cartwheel, forward a somersault.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ....body.motion import Motion, with_motion
from ....shot.motion_warping import turned
from ..assessment.solution_doubts import is_doubtful
from ..assessment.solution_ranking import cover_at, covering_most, is_hopeless
from ..equations.measurement import Workspace
from ..equations.problem import SegmentProblem, SegmentSolution
from ..gauss_newton import descend

SOLVED_TURNS = 3
"""Turned starts that are solved for somebody who is alone, those that cover most: how much a turn covers before it is
solved says little, as limbs move along with it and the hips travel."""


def with_whole_turn(
    problem: SegmentProblem, start: Sequence[Motion], first: SegmentSolution, workspace: Workspace
) -> tuple[Sequence[Motion], SegmentSolution]:
    """Solve from turned starts, if the images contradict a solution between two whole key poses.

    For one of several performers, only the start that covers most is solved, and none if all cover much less than the
    given one: there, others who hide the performer often contradict a solution.

    Parameters are those of `multi_start.best_of_own_starts`.

    Returns
    -------
    start : sequence of Motion
    solution : SegmentSolution
        Those with the turn that covers most once it is solved, if it covers more than the given solution; otherwise
        those that were given.
    """
    [performer] = problem.sought
    if problem.whole_keys(performer).tolist() != [0, problem.length - 1] or not is_doubtful(problem, first):
        return start, first
    ways = [turned(start[performer], problem.fixed[performer], axis) for axis in (*np.eye(3), *-np.eye(3))]
    starts = [with_motion(start, performer, way) for way in ways]
    quiet, one_of_several = workspace.silent(), problem.only is not None
    covers = [cover_at(problem, first, motions, quiet) for motions in starts]
    if one_of_several and is_hopeless(first, max(covers), cover_at(problem, first, start, quiet)):
        return start, first
    for k in np.argsort(covers)[::-1][: 1 if one_of_several else SOLVED_TURNS]:
        found = descend(problem, starts[k], quiet)
        if covering_most(problem, first, found) is found:
            start, first = starts[k], found
    return start, first
