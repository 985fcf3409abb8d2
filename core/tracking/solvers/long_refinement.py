"""Refining a long segment: on all frames at once, and again only around those on which something still moves."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

from ...body.motion import Motion
from ...numerics.arrays import Bools
from ...runtime.processes.freed_memory import return_freed_memory
from . import gauss_newton
from .descent_stages import POLISH, REFINEMENT, UNCONVERGED_MOVE, DescentStage
from .equations.measurement import Workspace
from .equations.problem import SegmentProblem, SegmentSolution
from .joint_moves import joint_moves
from .limb_corrections.local_trials import MAX_SHARE, can_be_parted, stretch_of, stretches_around

STEPS_ON_ALL_FRAMES = 2
"""Steps of the last stage that a long segment makes as a whole."""


def refine(
    problem: SegmentProblem,
    start: Sequence[Motion],
    workspace: Workspace,
    stages: Sequence[DescentStage] = REFINEMENT,
) -> SegmentSolution:
    """Refine a solution, as `gauss_newton.refine` does.

    The longer a segment, the likelier it is that some limb still moves somewhere. So the last stage of a long one makes
    `STEPS_ON_ALL_FRAMES` only, and it is refined again around the frames on which a joint moved by more than
    `UNCONVERGED_MOVE`, while the motion beside them stays.
    """
    if not can_be_parted(problem):
        return gauss_newton.refine(problem, start, workspace, stages)
    *coarse, last = stages
    repeated = partial(_refined_where_it_moves, problem, [last])
    at_once = [*coarse, replace(last, iterations=STEPS_ON_ALL_FRAMES, further=0)]
    return gauss_newton.refine(problem, start, workspace, at_once, repeated=repeated)


def polished_again(
    problem: SegmentProblem, polished: SegmentSolution, motions: Sequence[Motion], workspace: Workspace
) -> SegmentSolution:
    """Polish motions; in a long segment, around the frames on which they differ from a solution that is polished.

    Parameters
    ----------
    problem : SegmentProblem
    polished : SegmentSolution
    motions : sequence of Motion
        F poses per performer.
    workspace : Workspace
    """
    if not can_be_parted(problem):
        return refine(problem, motions, workspace, POLISH)
    differ = joint_moves(problem, polished.motions, motions) > 0
    return _refined_around(problem, POLISH, replace(polished, motions=tuple(motions)), differ, workspace)


def _refined_where_it_moves(
    problem: SegmentProblem, stages: Sequence[DescentStage], found: SegmentSolution, workspace: Workspace
) -> SegmentSolution:
    return _refined_around(problem, stages, found, found.moved >= UNCONVERGED_MOVE, workspace)


def _refined_around(
    problem: SegmentProblem,
    stages: Sequence[DescentStage],
    found: SegmentSolution,
    moving: Bools,
    workspace: Workspace,
) -> SegmentSolution:
    """Refine a solution around some frames (F,), and measure the result; on all frames at once if these are most of
    them.
    """
    stretches = [replace(stretch, held=(True, True)) for stretch in stretches_around(problem, moving)]
    if sum(stretch.last + 1 - stretch.first for stretch in stretches) > MAX_SHARE * problem.length:
        return gauss_newton.descend(problem, found.motions, workspace, stages)
    smooth, motions = problem.with_smoothness(found.variances), found.motions
    for k, stretch in enumerate(stretches):
        workspace.report(0.5 * k / len(stretches), motions)
        return_freed_memory(in_cycles=True)
        begin = [motion[stretch.first : stretch.last + 1] for motion in motions]
        here = gauss_newton.refine(stretch_of(smooth, stretch), begin, Workspace(workspace.by), stages)
        motions = tuple(m.replaced(stretch.first, own) for m, own in zip(motions, here.motions, strict=True))
    measured = [replace(stage, iterations=0, further=0) for stage in stages]
    return gauss_newton.descend(problem, motions, workspace.part(0.5, 1.0), measured)
