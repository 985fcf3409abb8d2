"""Refining a long segment: on all frames at once, and again only around those on which something still moves."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

from ...body.motion import Motion
from ...runtime.freed_memory import return_freed_memory
from . import gauss_newton
from .descent_stages import REFINEMENT, UNCONVERGED_MOVE, DescentStage
from .equations.measurement import Workspace
from .equations.problem import SegmentProblem, SegmentSolution
from .limb_corrections.local_trials import MAX_SHARE, can_be_parted, stretch_of, stretches_around


def refine(
    problem: SegmentProblem,
    start: Sequence[Motion],
    workspace: Workspace,
    stages: Sequence[DescentStage] = REFINEMENT,
) -> SegmentSolution:
    """Refine a solution, as `gauss_newton.refine` does.

    The longer a segment, the likelier it is that some limb still moves somewhere. So a long one is refined again around
    the frames on which a joint moved by more than `UNCONVERGED_MOVE`, while the motion beside them stays, before the
    last stage is repeated on all frames: most of them are at rest, and it ends by its first evaluation.
    """
    if not can_be_parted(problem):
        return gauss_newton.refine(problem, start, workspace, stages)
    around = partial(_refined_around, problem, stages[-1:])
    return gauss_newton.refine(problem, start, workspace, stages, before_repeats=around)


def _refined_around(
    problem: SegmentProblem, stages: Sequence[DescentStage], found: SegmentSolution, workspace: Workspace
) -> tuple[Motion, ...]:
    """Return the motions of a solution, refined around the frames on which it moved; the same if these are most."""
    problem, motions = problem.with_smoothness(found.variances), found.motions
    moving = found.moved >= UNCONVERGED_MOVE
    stretches = [replace(stretch, held=(True, True)) for stretch in stretches_around(problem, moving)]
    if sum(stretch.last + 1 - stretch.first for stretch in stretches) > MAX_SHARE * problem.length:
        return motions
    for k, stretch in enumerate(stretches):
        workspace.report(k / len(stretches), motions)
        return_freed_memory(in_cycles=True)
        begin = [motion[stretch.first : stretch.last + 1] for motion in motions]
        here = gauss_newton.refine(stretch_of(problem, stretch), begin, Workspace(workspace.by), stages)
        motions = tuple(m.replaced(stretch.first, own) for m, own in zip(motions, here.motions, strict=True))
    return motions
