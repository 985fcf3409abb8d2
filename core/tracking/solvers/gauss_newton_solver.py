"""The default solver from beginning to end: who solves, who doubts, who proposes, who decides.

Least squares finds only the minimum nearest to its start, and a lost arm or a body that turned the other way round is
another minimum. Solving a segment is therefore a conversation of four:

- `gauss_newton.descend` *solves*: it leads a start to its nearest minimum. Nobody else changes a motion to fit images.
- `assessment.solution_doubts` *doubts*: it tests a solution against the images, and names the performers whom they
  contradict. Where there are none, the first solution stands.
- `starts` and `limb_corrections` *propose*: other motions of the whole body, or of a single limb, from which a descent
  may reach a better minimum. A proposal need not be good, only near the true motion.
- `assessment.solution_ranking` *decides*: all solutions are measured under one noise, and the likeliest is taken.

`multi_start.best_of_starts` holds that conversation for the whole body, in the order: the curve through the key poses,
another turn, the motion followed frame by frame, and rounds of the search for limbs. Every module of `limb_corrections`
holds it once more for one kind of error. This module calls them in turn, for the tracker.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from ...body.motion import Motion
from ...evidence.view_frames import views_with_foreground
from ...runtime.processes.freed_memory import return_freed_memory
from ...runtime.timing import Seconds
from .approach import approach
from .assessment.settled_solutions import SettledSolution, unsettled
from .assessment.solution_doubts import doubted_performers, frames_in_doubt, misfit_at, performers_uncovered
from .assessment.solution_ranking import clearly_likelier
from .descent_stages import (
    FREE_FROM_CURVE,
    OUTLINE_REACH,
    POLISH,
    POLISHED_AT_ONCE,
    REFINEMENT,
    RESUMED,
    SETTLED,
    STAGES,
    STAGES_ON_ALL_FRAMES,
    DescentStage,
)
from .equations.measurement import Workspace
from .equations.problem import AccelerationSearch, SegmentProblem, SegmentSolution
from .gauss_newton import continued, descend
from .joint_moves import farthest_joint
from .limb_corrections.leaping_limbs import with_leaps_bridged
from .limb_corrections.limb_exchange import with_crossed_limbs_exchanged
from .limb_corrections.limb_gains import contradicted
from .limb_corrections.limb_search import can_search_limbs
from .limb_corrections.local_trials import HELD_FRAMES, Stretch, can_be_parted, stretch_of, stretches_around
from .limb_corrections.regained_limbs import with_limbs_regained
from .limb_corrections.wound_ends import with_ends_unwound
from .long_refinement import polished_again, refine
from .multi_start import best_of_starts, first_solution, searched_once, with_sides_exchanged
from .thinned_frames import ThinnedProblem


def solved(problem: SegmentProblem, start: Sequence[Motion], workspace: Workspace) -> SegmentSolution:
    """Solve from several starts, exchange limbs that reach across each other, and bridge leaps of limbs.

    Where frames follow each other closely, all of this is done on some of them, and the motion of the others is
    interpolated (`thinned_frames`); the solution then carries no evidence. If the images contradict the first solution
    on these, all frames are tried once, as a fast limb may be lost for the lack of frames only, and other motions are
    searched for around what these lead to. In a long segment, both is done around the frames in doubt alone
    (`_with_doubts_pursued`). Parameters as in `gauss_newton.descend`.
    """
    thinned = ThinnedProblem.of(problem, start)
    if thinned is None:
        if not can_be_parted(problem):
            return _solved(problem, start, workspace)
        thinned = ThinnedProblem(problem, np.arange(problem.length), 1, problem)
    few, begin, inner = thinned.problem, thinned.of_motions(start), thinned.workspace(workspace.part(0.6, 1.0))
    in_parts = problem.settings.limb_search and can_be_parted(few)
    beginning = thinned.workspace(workspace.part(0.0, 0.6))
    first = descend(few, begin, beginning, FREE_FROM_CURVE) if in_parts else first_solution(few, begin, beginning)
    if not (problem.settings.limb_search and doubted_performers(few, begin, first)):
        return thinned.on_all_frames(_solved(few, begin, inner, first=first))
    if in_parts and (stretches := stretches_around(few, frames_in_doubt(few, first))):
        return _with_doubts_pursued(thinned, first, stretches, workspace.part(0.6, 1.0))
    return _pursued(thinned, start, workspace.part(0.6, 1.0), first)


def _pursued(
    thinned: ThinnedProblem, start: Sequence[Motion], workspace: Workspace, before: SegmentSolution | None = None
) -> SegmentSolution:
    """Solve on all frames what the images contradict on some of them and, if they still do, search on these. If they do
    not, left and right limbs of a single performer are exchanged in several views where that is better: each may have
    taken the other's pictures for its own.

    `start` has F poses per performer; `before` as in `_first_on_all_frames`.
    """
    problem, few, inner = thinned.whole, thinned.problem, thinned.workspace(workspace.part(0.3, 1.0))
    whole = _first_on_all_frames(thinned, start, workspace.part(0.0, 0.3), before)
    if few is problem:
        return _solved(problem, start, workspace.part(0.3, 1.0), first=whole)
    if not doubted_performers(problem, start, whole):
        if problem.shows_depth and not problem.among_others:
            whole = with_sides_exchanged(problem, whole, workspace.part(0.3, 0.5))
        return _solved(problem, start, workspace.part(0.5, 1.0), first=whole)
    first = _after(whole, descend(few, thinned.of_motions(whole.motions), inner.silent(), SETTLED))
    if before is None and (once := searched_once(few, first, inner)) is not None:
        return thinned.on_all_frames(_with_limbs_put_right(few, once, inner.silent()))
    return thinned.on_all_frames(_solved(few, thinned.of_motions(start), inner, first=first))


def _first_on_all_frames(
    thinned: ThinnedProblem, start: Sequence[Motion], workspace: Workspace, before: SegmentSolution | None
) -> SegmentSolution:
    """Return the first solution on all frames, with the iterations and the time of the one before on some of them.

    There is none before in a window of a long segment. What the images contradict there was found with soles left free,
    so those that seem planted are held from the beginning. Where frames are left out, few steps are made on all of
    them: the search goes on with the others alone.
    """
    whole, some_left_out = thinned.whole, thinned.problem is not thinned.whole
    if before is None:
        return descend(whole, start, workspace, STAGES_ON_ALL_FRAMES if some_left_out else STAGES)
    return _after(before, first_solution(whole, start, workspace)) if some_left_out else before


def _with_doubts_pursued(
    thinned: ThinnedProblem, first: SegmentSolution, stretches: Sequence[Stretch], workspace: Workspace
) -> SegmentSolution:
    """Solve and search where the images contradict a solution on some of the frames, while the motion beside these
    frames stays as if it were known; then correct limbs as in any solution.

    The solution counts as doubted no more: limbs that are still lost are found by the signs that they show.
    """
    few = thinned.problem.with_smoothness(first.variances)
    same = thinned.problem is thinned.whole
    whole = few if same else thinned.whole.with_smoothness(thinned.variances(first))
    thinned = replace(thinned, whole=whole, problem=few)
    first = replace(first, motions=tuple(thinned.interpolated(first.motions)))
    first = _solved_around(thinned, first, stretches, workspace.part(0.0, 0.9))
    begin = unsettled(few, tuple(thinned.of_motions(first.motions)), workspace.silent())
    begin = replace(begin, variances=first.variances)
    solution = _with_limbs_put_right(few, begin, thinned.workspace(workspace.part(0.9, 1.0)))
    if solution.motions is begin.motions:
        return replace(thinned.on_all_frames(_after(first, begin)), motions=first.motions)
    return thinned.on_all_frames(_after(first, solution))


def _solved_around(
    thinned: ThinnedProblem, first: SegmentSolution, stretches: Sequence[Stretch], workspace: Workspace
) -> SegmentSolution:
    """Return a solution with motions of all frames, solved and searched on some stretches of the kept ones."""
    motions = first.motions
    for k, stretch in enumerate(stretches):
        part, own = _part(thinned, stretch), slice(thinned.frames[stretch.first], thinned.frames[stretch.last] + 1)
        return_freed_memory(in_cycles=True)
        share = workspace.part(k / len(stretches), (k + 1) / len(stretches))
        report = partial(_report_all, share, motions)
        found = _pursued(part, [motion[own] for motion in motions], Workspace(workspace.by, on_step=report))
        motions = tuple(m.replaced(own.start, new) for m, new in zip(motions, found.motions, strict=True))
        first = _after(found, first)
    return replace(first, motions=motions)


def _report_all(workspace: Workspace, motions: Sequence[Motion], done: float, part: Sequence[Motion]) -> None:
    """Report motions of a whole segment in place of those of a part that is being solved."""
    workspace.report(done, motions if part else ())


def _part(thinned: ThinnedProblem, stretch: Stretch) -> ThinnedProblem:
    """Return the problem on a stretch of the kept frames, with those at its ends held (`stretch_of`)."""
    frames = thinned.frames[stretch.first : stretch.last + 1] - thinned.frames[stretch.first]
    begin, held = int(thinned.frames[stretch.first]), int(frames[HELD_FRAMES - 1]) + 1
    few = stretch_of(thinned.problem, stretch)
    if thinned.problem is thinned.whole:
        return replace(thinned, whole=few, frames=frames, problem=few)
    whole = stretch_of(thinned.whole, Stretch(begin, begin + int(frames[-1]), stretch.held), held)
    return replace(thinned, whole=whole, frames=frames, problem=few)


def _solved(
    problem: SegmentProblem, start: Sequence[Motion], workspace: Workspace, first: SegmentSolution | None = None
) -> SegmentSolution:
    """Solve a problem on all of its frames; `first` is the solution from the start, if it is known.

    In a single view of a single performer, usual accelerations may draw a fast limb back from wherever a search finds
    it. If foreground of a limb stays uncovered, the problem is solved once more with the accelerations of every joint
    estimated, and that solution is taken unless the first is clearly likelier.
    """
    usual = problem.search is AccelerationSearch.SCALE_THEN_JOINTS and not problem.among_others
    solution = _with_corrections(problem, start, workspace.part(0.0, 0.6 if usual else 1.0), first)
    if not usual or not solution.doubted:
        return solution
    if not performers_uncovered(problem, solution.motions):
        return solution
    freed = replace(problem, search=AccelerationSearch.JOINTS)
    settled = SettledSolution.after(problem, solution, workspace.silent())
    faster = _with_corrections(freed, start, workspace.part(0.6, 1.0))
    other = _after(faster, descend(freed, faster.motions, workspace.silent(), SETTLED, settled.noise))
    if clearly_likelier(problem, settled.noise, settled.solution, other):
        return _after(other, solution)
    return _after(solution, replace(other, doubted=faster.doubted))


def _with_corrections(
    problem: SegmentProblem, start: Sequence[Motion], workspace: Workspace, first: SegmentSolution | None = None
) -> SegmentSolution:
    """Solve from several starts, exchange limbs that reach across each other, and bridge leaps."""
    solution = best_of_starts(problem, start, workspace.part(0.0, 0.9), first)
    return _with_limbs_put_right(problem, solution, workspace.part(0.9, 1.0))


def _with_limbs_put_right(problem: SegmentProblem, solution: SegmentSolution, workspace: Workspace) -> SegmentSolution:
    """Exchange limbs that reach across each other, and bridge leaps."""
    if not can_search_limbs(problem):
        return solution
    solution = with_crossed_limbs_exchanged(problem, solution, workspace.part(0.0, 0.5))
    if problem.among_others:  # leaps are few once all pixels count, in the refinement
        return solution
    return with_leaps_bridged(problem, solution, workspace.part(0.5, 1.0))


def refined(problem: SegmentProblem, start: Sequence[Motion], workspace: Workspace) -> SegmentSolution:
    """Refine a solution now that the motion beside the segment is known, search again for lost limbs, and polish what
    was found.

    In several views, a solution that nothing has contradicted, and every one for several performers, is refined and
    polished at once, and polished again only if a limb was found elsewhere. Whom others hide is seen by few pixels:
    with all of them, most limbs that look lost are not, and need no search. Several who are polished already are only
    polished again, those in doubt after coarser steps. Where the solution for a single performer was contradicted and
    frames follow each other closely, limbs are searched for on some of them. Parameters as in `gauss_newton.descend`.
    """
    if problem.doubted and (thinned := ThinnedProblem.of(problem, start)) is not None:
        share = 0.9
        _, few = _refined_and_searched(
            thinned.problem, thinned.of_motions(start), thinned.workspace(workspace.part(0.0, 0.6)), REFINEMENT
        )
        begin = thinned.interpolated(few.motions)
        found = _after(few, refine(problem, begin, workspace.part(0.6, share)))
    else:
        at_once = problem.shows_depth and (not problem.doubted or problem.among_others)
        stages = POLISHED_AT_ONCE if at_once else REFINEMENT
        share = 0.95 if at_once else 0.6
        first, found = _refined_and_searched(problem, start, workspace.part(0.0, share), stages)
        if stages is POLISHED_AT_ONCE:
            if found.motions is first.motions:
                return found
            first, found = first.without_equations(), found.without_equations()  # those of a long segment are large
            return _after(found, polished_again(problem, first, found.motions, workspace.part(share, 1.0)))
    return _after(found, refine(problem, found.motions, workspace.part(share, 1.0), POLISH))


def _refined_and_searched(
    problem: SegmentProblem, start: Sequence[Motion], workspace: Workspace, stages: Sequence[DescentStage]
) -> tuple[SegmentSolution, SegmentSolution]:
    """Return a refined solution, and the one that a search for limbs leads to from there; if limbs cannot be searched
    for, the refined one with its ends unwound (`wound_ends`).
    """
    # With several views, limbs are searched for in many segments, and that takes most of the time where it is done.
    share = 0.2 if contradicted(problem) else 0.6 if problem.shows_depth else 0.7
    searching = workspace.part(share, 1.0)
    if problem.polished:  # those in doubt have been moved since
        for i in problem.doubted:
            start = approach(problem.alone(i), start, workspace.silent(), stages[:-1]).motions
        stages = POLISH
    first = refine(problem, start, workspace.part(0.0, share), stages)
    if not can_search_limbs(problem):
        shown = problem.settings.limb_search and views_with_foreground(problem.views)
        return first, with_ends_unwound(problem, first, searching) if shown else first
    several = problem.among_others
    begin = with_crossed_limbs_exchanged(problem, first, workspace.silent())
    bridged = with_leaps_bridged(problem, begin, searching.part(0.0, 0.1), long_only=not several)
    if bridged.motions is not begin.motions:
        bridged = _after(bridged, refine(problem, bridged.motions, searching.part(0.1, 0.2)))
    return first, with_limbs_regained(problem, bridged, searching.part(0.2, 1.0))


def _after(before: SegmentSolution, found: SegmentSolution) -> SegmentSolution:
    """Return the second of two solutions, with the iterations and the time of both."""
    seconds = Seconds(before.seconds)
    seconds.add(found.seconds)
    return replace(continued(before, found), seconds=dict(seconds))


def resumed(
    problem: SegmentProblem, start: Sequence[Motion], workspace: Workspace, before: Sequence[Motion]
) -> SegmentSolution | None:
    """Solve from the motion that was found before key poses changed; None where the images contradict the result.

    Foreground beside the earlier motion was searched for limbs then. It does not count again, unless key poses moved
    farther than a descent reaches.

    Parameters as in `gauss_newton.descend`; `before` as in `protocol.Resume`.
    """
    found = descend(problem, start, workspace, RESUMED)
    found = replace(found, misfit=misfit_at(problem, found.motions, workspace.by))
    searched = start if farthest_joint(problem, before, start) < OUTLINE_REACH else None
    return None if doubted_performers(problem, start, found, searched) else found
