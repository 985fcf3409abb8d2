"""Searching again for limbs once a segment is solved and the motion beside it is known.

Limbs that show a sign of being lost are searched for (`limb_signs`), and pairs of which both limbs do. Others show no
sign. If the images contradicted the first solution of a single performer, the whole body is therefore led out of its
minimum once, and all limbs and pairs are searched for.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from ....body.limbs import limb_pairs, limbs
from ....body.motion import Motion
from ....numerics.arrays import Array
from ....runtime.processes.freed_memory import return_freed_memory
from ....runtime.timing import Seconds
from ..assessment.limb_signs import (
    bent_limbs,
    faded_limbs,
    frames_weakly_shown,
    refuted_limbs,
    unshown_limbs,
    weakly_shown_limbs,
)
from ..assessment.settled_solutions import SettledSolutions, unsettled
from ..assessment.solution_doubts import others_hide
from ..assessment.solution_ranking import likelihood_decides
from ..descent_stages import COARSE_RESTART, SETTLED
from ..equations.measurement import Workspace
from ..equations.problem import SegmentProblem, SegmentSolution
from ..gauss_newton import descend
from ..limb_evidence.limb_images import ViewRatios
from ..limb_evidence.limb_support import SupportOfLimb, evaluated, support_of_limbs
from ..thinned_frames import ThinnedProblem
from .limb_gains import contradicted
from .limb_groups import continued_where_likelier, likeliest_found, with_limbs_found, with_limbs_moved
from .limb_proposals import LimbGroup, frames_searched
from .limb_search import views_of
from .local_trials import Stretch, is_long, stretch_of, stretches_around
from .swivelled_limbs import with_limbs_swivelled
from .wound_ends import with_ends_unwound


def with_limbs_regained(problem: SegmentProblem, solution: SegmentSolution, workspace: Workspace) -> SegmentSolution:
    """Search again for limbs of a refined solution that may be lost; then heads, hands and feet are
    unwound (`wound_ends`).

    In a long segment, limbs that the images show weakly for a moment are searched for around it, while the motion
    beside it stays.

    Parameters
    ----------
    problem : SegmentProblem
    solution : SegmentSolution
    workspace : Workspace
    """
    seconds = Seconds(solution.seconds)
    with seconds.measure("initial solution"):
        support = _support_of(problem, solution)
        groups = suspected_groups(problem, solution, support)
        if stretches := _stretches_of(problem, groups, support):
            solution = _searched_in_stretches(problem, solution, stretches, workspace)
        else:
            solution = _searched(problem, solution, groups, SettledSolutions(), workspace)
        solution = with_ends_unwound(problem, solution, workspace.silent())
    return replace(solution, seconds=dict(seconds))


def _stretches_of(
    problem: SegmentProblem, groups: Sequence[LimbGroup], support: Iterable[SupportOfLimb]
) -> list[tuple[LimbGroup, list[Stretch]]]:
    """Return groups of limbs with the stretches of a long segment around the frames on which all of a group are weakly
    shown, or with stretches of all frames where another sign calls for one of them; nothing in other segments.
    """
    if contradicted(problem) or problem.among_others or not (problem.shows_depth and is_long(problem)):
        return []
    weak = {tuple(chain): frames_weakly_shown(problem, i, shown()) for i, chain, _, shown in support}
    found = []
    for group in groups:
        each = [weak[tuple(chain)] for chain in group.chains]
        together = np.all([own | (not own.any()) for own in each], axis=0)
        found.append((group, [replace(own, held=(True, True)) for own in stretches_around(problem, together)]))
    return found


def _searched_in_stretches(
    problem: SegmentProblem,
    solution: SegmentSolution,
    stretches: Sequence[tuple[LimbGroup, Sequence[Stretch]]],
    workspace: Workspace,
) -> SegmentSolution:
    """Search for groups of limbs on ranges of frames, and keep what makes the images likelier there; the solution
    carries no evidence then.
    """
    workspace.recent.forget()  # the evaluations of a long segment are large
    found, there = solution.motions, dict[Stretch, list[LimbGroup]]()
    for group, ranges in stretches:
        for stretch in ranges:
            there.setdefault(stretch, []).append(group)
    for k, (stretch, groups) in enumerate(there.items()):
        workspace.report(k / len(there), found)
        return_freed_memory(in_cycles=True)
        here = tuple(motion[stretch.first : stretch.last + 1] for motion in found)
        moved = _found_there(stretch_of(problem, stretch), here, groups, workspace)
        if moved is not here:
            found = tuple(m.replaced(stretch.first, own) for m, own in zip(found, moved, strict=True))
    return solution if found is solution.motions else replace(solution, motions=found, evidence=None)


def _found_there(
    problem: SegmentProblem, motions: tuple[Motion, ...], groups: Sequence[LimbGroup], workspace: Workspace
) -> tuple[Motion, ...]:
    """Search for groups of limbs of one performer on the frames of a stretch, and return the motions, the same ones if
    none is found.

    Where frames follow each other closely, rounds are made on some of them: most are in vain. What is likelier on these
    is solved for, and judged, on all, where more is to be gained.
    """
    thinned = ThinnedProblem.of(problem, motions)
    inner, known = Workspace(workspace.by), SettledSolutions()
    if thinned is None:
        solution = unsettled(problem, motions, inner)
        for group in groups:
            solution = with_limbs_found(problem, solution, group, known, inner)
        return solution.motions
    few = None
    for group in groups:
        few = few or unsettled(thinned.problem, tuple(thinned.of_motions(motions)), inner)
        found = likeliest_found(thinned.problem, few, group, known, inner)
        if found is None:
            continue
        judging = Workspace(workspace.by)
        begin = unsettled(problem, motions, judging)
        end = with_limbs_moved(problem, begin, group, thinned.interpolated(found.motions), judging)
        if end is not begin:
            motions, few = end.motions, None
    return motions


def suspected_groups(
    problem: SegmentProblem, solution: SegmentSolution, support: Iterable[SupportOfLimb]
) -> list[LimbGroup]:
    """Return the limbs that are worth a search, and the pairs of such limbs.

    These are all limbs of a single performer whom the images contradicted, where likelihood singles out the true
    motion. Otherwise they show a sign: that they have faded counts where performers hide one another, and that they are
    weakly shown there, too, and for a single performer, in several views. Where performers hide one another, signs do
    not count for limbs that the images do not show on the key poses either.

    Parameters
    ----------
    problem : SegmentProblem
    solution : SegmentSolution
    support : iterable of SupportOfLimb
        See `_support_of`.
    """
    single = not problem.among_others
    if contradicted(problem) and likelihood_decides(problem):
        places = [(0, chain) for chain in limbs(problem.bodies[0])]
    else:
        motions, hidden = solution.motions, others_hide(solution.unhidden)
        places = [(i, chain) for i in problem.searched for chain in bent_limbs(problem, i, motions[i])]
        places += refuted_limbs(problem, support)
        places += faded_limbs(problem, support) if hidden else []
        places += weakly_shown_limbs(problem, support) if problem.shows_depth and (single or hidden) else []
        unshown = unshown_limbs(problem, support) if hidden else []
        places = [place for place in places if place not in unshown]
    groups = [LimbGroup(i, (chain,)) for k, (i, chain) in enumerate(places) if (i, chain) not in places[:k]]
    if single and problem.shows_depth:
        pairs = [pair for pair in limb_pairs(problem.bodies[0]) if all((0, chain) in places for chain in pair)]
        groups += [LimbGroup(0, pair) for pair in pairs]
    return groups


def _support_of(problem: SegmentProblem, solution: SegmentSolution) -> Iterable[SupportOfLimb]:
    """Measure what the images say for limbs: all of it, as a list, if `suspected_groups` asks for it several times;
    nothing if it does not ask.
    """
    if contradicted(problem) and likelihood_decides(problem):
        return []
    measured = _support_on_some_frames(problem, solution.motions)
    several = others_hide(solution.unhidden) or (problem.shows_depth and not problem.among_others)
    return evaluated(measured) if several else measured


def _searched(
    problem: SegmentProblem,
    solution: SegmentSolution,
    groups: Sequence[LimbGroup],
    known: SettledSolutions,
    workspace: Workspace,
) -> SegmentSolution:
    """Search for groups of limbs, those of one performer after those of another: what the views show of one of several
    is collected once, as the others stay where they are.
    """
    if contradicted(problem) and likelihood_decides(problem):
        solution = _stirred(problem, solution, known, workspace.silent())
    several, done = problem.among_others, 0
    for performer in dict.fromkeys(group.performer for group in groups):
        ratios = _views_searched(problem.alone(performer), solution.motions, performer) if several else None
        for group in (group for group in groups if group.performer == performer):
            part = workspace.part(done / len(groups), (done + 1) / len(groups))
            solution = with_limbs_found(problem, solution, group, known, part, ratios=ratios)
            done += 1
    if groups and contradicted(problem) and problem.shows_depth:
        solution = with_limbs_swivelled(problem, solution, known, workspace.silent())
    return solution


def _views_searched(alone: SegmentProblem, motions: Sequence[Motion], performer: int) -> list[ViewRatios]:
    """Collect what the views show of one of several performers on the frames on which its limbs are searched for."""
    thinned = frames_searched(alone, motions)
    return views_of(thinned.problem, thinned.of_motions(motions), performer)


def _support_on_some_frames(problem: SegmentProblem, motions: Sequence[Motion]) -> Iterator[SupportOfLimb]:
    """Generate the `support_of_limbs`; of a single performer, where frames follow each other closely, measured on some
    of them and interpolated.
    """
    thinned = None if problem.among_others else ThinnedProblem.of(problem, motions)
    if thinned is None:
        yield from support_of_limbs(problem, motions)
        return
    for i, chain, sides, shown in support_of_limbs(thinned.problem, thinned.of_motions(motions)):
        yield i, chain, thinned.between(sides), partial(_between, thinned, shown)


def _between(thinned: ThinnedProblem, shown: Callable[[], Array]) -> Array:
    return thinned.between(shown())


def _stirred(
    problem: SegmentProblem, solution: SegmentSolution, known: SettledSolutions, workspace: Workspace
) -> SegmentSolution:
    """Lead a single performer out of its minimum by coarse steps, and return the likelier solution.

    A trunk and a leg may be wrong together, so that neither is found while the other stays.
    """
    first = known.after(problem, solution, workspace)
    found = descend(problem, first.solution.motions, workspace, (*COARSE_RESTART, *SETTLED), first.noise)
    return continued_where_likelier(problem, solution, first, found, workspace)
