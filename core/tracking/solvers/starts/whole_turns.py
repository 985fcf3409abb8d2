"""A start in which the whole body turns once more, or the other way round, between two key poses.

The curve through the key poses takes the shorter way from each to the next, so that a spin by nearly a turn passes for
standing still. The start with the other way is the same curve with a whole turn about one of the pelvis's axes added:
upright a spin, sideways a cartwheel, forward a somersault. Where such even turns do not explain the images, turns are
tried that are placed by them (`placed_turns`).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ....body.motion import Motion, with_motion
from ....shot.motion_warping import turned
from ..approach import approach
from ..assessment.solution_doubts import frames_unexplained
from ..assessment.solution_ranking import cover_at, covering_most
from ..descent_stages import COARSE_STAGES, FINE_STAGES, DescentStage
from ..equations.measurement import Workspace
from ..equations.problem import SegmentProblem, SegmentSolution
from ..gauss_newton import descend
from .placed_turns import placed_turns

SOLVED_TURNS = 2
"""Turned starts that are solved: those that cover most after the coarse stages. Before that, how much a turn covers
says little, as limbs move along with it and the hips travel."""
LEAST_UNEXPLAINED = 0.25
"""Share of the frames on which a performer must be unexplained for a turn to be tried. Without the turn the body is
turned away by more than a right angle on about half of them; one of whom a limb is lost or whom others hide is
unexplained on a few."""


def with_whole_turn(
    problem: SegmentProblem,
    start: Sequence[Motion],
    first: SegmentSolution,
    workspace: Workspace,
    stages: Sequence[DescentStage] = FINE_STAGES,
) -> tuple[Sequence[Motion], SegmentSolution]:
    """Solve from turned starts, if the images contradict a solution between two whole key poses.

    Parameters are those of `multi_start.best_of_own_starts`, and the stages by which turns are solved after the coarse
    ones: those by which the first solution was found, as what is solved further covers more.

    Returns
    -------
    start : sequence of Motion
    solution : SegmentSolution
        Those with the turn that covers most once it is solved, if it covers more than the given solution; otherwise
        those that were given.
    """
    [performer] = problem.sought
    if problem.whole_keys(performer).tolist() != [0, problem.length - 1]:
        return start, first
    if not _is_unexplained(problem, first, performer):
        return start, first
    ways = [turned(start[performer], problem.fixed[performer], axis) for axis in (*np.eye(3), *-np.eye(3))]
    starts = [with_motion(start, performer, way) for way in ways]
    quiet = workspace.silent()
    begun = [approach(problem, motions, quiet, COARSE_STAGES) for motions in starts]
    covers = [cover_at(problem, first, own.motions, quiet) for own in begun]
    best: tuple[Sequence[Motion], SegmentSolution] = start, first
    for k in np.argsort(covers)[::-1][:SOLVED_TURNS]:
        best = _covering_more(problem, best, (starts[k], descend(problem, begun[k], quiet, stages)))
    if problem.only is None and problem.shows_depth and _is_unexplained(problem, best[1], performer):
        for motions in placed_turns(problem, start, best[1].cover, quiet)[:SOLVED_TURNS]:
            coarse = approach(problem, motions, quiet, COARSE_STAGES)
            best = _covering_more(problem, best, (motions, descend(problem, coarse, quiet, stages)))
    return best


def _covering_more(
    problem: SegmentProblem,
    best: tuple[Sequence[Motion], SegmentSolution],
    other: tuple[Sequence[Motion], SegmentSolution],
) -> tuple[Sequence[Motion], SegmentSolution]:
    """Return the best start so far and its solution, or others if their solution covers more."""
    return other if covering_most(problem, best[1], other[1]) is other[1] else best


def _is_unexplained(problem: SegmentProblem, solution: SegmentSolution, performer: int) -> bool:
    return len(frames_unexplained(problem, solution, performer)) >= LEAST_UNEXPLAINED * problem.length
