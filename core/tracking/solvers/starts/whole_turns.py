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


def with_whole_turn(
    problem: SegmentProblem, start: Sequence[Motion], first: SegmentSolution, workspace: Workspace
) -> tuple[Sequence[Motion], SegmentSolution]:
    """Solve from the turned start that covers most, if the images contradict a solution between two whole key poses.

    Nothing is solved if every turned start covers much less than the given one: a body that turns covers the performer
    better with the turn, wherever its limbs are.

    Parameters are those of `multi_start.best_of_own_starts`.

    Returns
    -------
    start : sequence of Motion
    solution : SegmentSolution
        Those with the turn if they cover more, otherwise those that were given.
    """
    [performer] = problem.sought
    if problem.whole_keys(performer).tolist() != [0, problem.length - 1] or not is_doubtful(problem, first):
        return start, first
    ways = [turned(start[performer], problem.fixed[performer], axis) for axis in (*np.eye(3), *-np.eye(3))]
    starts = [with_motion(start, performer, way) for way in ways]
    quiet = workspace.silent()
    covers = [cover_at(problem, first, motions, quiet) for motions in starts]
    if is_hopeless(first, max(covers), cover_at(problem, first, start, quiet)):
        return start, first
    most = starts[int(np.argmax(covers))]
    found = descend(problem, most, workspace)
    return (most, found) if covering_most(problem, first, found) is found else (start, first)
