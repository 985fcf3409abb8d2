"""Searching again for limbs once a segment is solved and the motion beside it is known.

Limbs that show a sign of being lost are searched for (`limb_signs`), and pairs of which both limbs do. Others show no
sign. If the images contradicted the first solution of a single performer, the whole body is therefore led out of its
minimum once, and all limbs and pairs are searched for.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial

from ....body.limbs import limb_pairs, limbs
from ....body.motion import Motion
from ....numerics.arrays import Array
from ....runtime.timing import Seconds
from ..descent_stages import COARSE_RESTART, SETTLED, UNCONVERGED_MOVE
from ..equations.measurement import Workspace
from ..equations.problem import SegmentProblem, SegmentSolution
from ..gauss_newton import continued, descend, farthest_joint
from ..judgement.limb_signs import bent_limbs, faded_limbs, refuted_limbs, weakly_shown_limbs
from ..judgement.settled_solutions import SettledSolutions
from ..judgement.solution_doubts import MIN_FOLLOWED_SHARE
from ..judgement.solution_ranking import likelihood, likelihood_decides, settled_further
from ..limb_evidence.limb_likelihood import SupportOfLimb, evaluated, support_of_limbs
from ..thinned_frames import ThinnedProblem
from .limb_groups import LimbGroup, contradicted, least_gain, solved_from, with_limbs_found


def with_limbs_regained(problem: SegmentProblem, solution: SegmentSolution, workspace: Workspace) -> SegmentSolution:
    """Search again for limbs of a refined solution that may be lost.

    Where frames follow each other closely, limbs are searched for on some of them (`thinned_frames`), and what is found
    there is solved for, and judged, on all.

    Parameters
    ----------
    problem : SegmentProblem
    solution : SegmentSolution
    workspace : Workspace
    """
    seconds = Seconds(solution.seconds)
    with seconds.measure("initial solution"):
        groups, known = suspected_groups(problem, solution), SettledSolutions()
        single = not problem.among_others
        thinned = ThinnedProblem.of(problem, solution.motions) if groups and single else None
        if thinned is None:
            solution = _searched(problem, solution, groups, known, workspace)
        else:
            inner = thinned.workspace(workspace)
            few = descend(thinned.problem, thinned.of_motions(solution.motions), inner, SETTLED)
            found = _searched(thinned.problem, few, groups, SettledSolutions(), inner)
            if found.motions is not few.motions:
                first = known.after(problem, solution, workspace)
                there = solved_from(problem, thinned.interpolated(found.motions), first.noise, workspace)
                gain = likelihood(problem, first.noise, there) - likelihood(problem, first.noise, first.solution)
                solution = continued(solution, there) if gain > least_gain(problem) else solution
    return replace(solution, seconds=dict(seconds))


def suspected_groups(problem: SegmentProblem, solution: SegmentSolution) -> list[LimbGroup]:
    """Return the limbs that are worth a search, and the pairs of such limbs.

    These are all limbs of a single performer whom the images contradicted, where likelihood singles out the true
    motion. Otherwise they show a sign: that they have faded counts where performers hide one another, and that they are
    weakly shown counts for a single performer in several views.
    """
    single = not problem.among_others
    if contradicted(problem) and likelihood_decides(problem):
        places = [(0, chain) for chain in limbs(problem.bodies[0])]
    else:
        motions, hidden = solution.motions, solution.unhidden.min() <= MIN_FOLLOWED_SHARE
        weakly = single and problem.shows_depth
        measured = _support_on_some_frames(problem, motions)
        support = evaluated(measured) if hidden or weakly else measured
        places = [(i, chain) for i in problem.sought for chain in bent_limbs(problem, i, motions[i])]
        places += refuted_limbs(problem, support)
        places += faded_limbs(problem, support) if hidden else []
        places += weakly_shown_limbs(problem, support) if weakly else []
    groups = [LimbGroup(i, (chain,)) for k, (i, chain) in enumerate(places) if (i, chain) not in places[:k]]
    if single and problem.shows_depth:
        pairs = [pair for pair in limb_pairs(problem.bodies[0]) if all((0, chain) in places for chain in pair)]
        groups += [LimbGroup(0, pair) for pair in pairs]
    return groups


def _searched(
    problem: SegmentProblem,
    solution: SegmentSolution,
    groups: Sequence[LimbGroup],
    known: SettledSolutions,
    workspace: Workspace,
) -> SegmentSolution:
    if contradicted(problem) and likelihood_decides(problem):
        solution = _stirred(problem, solution, known, workspace.silent())
    for k, group in enumerate(groups):
        part = workspace.part(k / len(groups), (k + 1) / len(groups))
        solution = with_limbs_found(problem, solution, group, known, part)
    return solution


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
    if farthest_joint(problem, first.solution.motions, found.motions) < UNCONVERGED_MOVE:
        return solution
    rival = likelihood(problem, first.noise, first.solution) + least_gain(problem)
    found = settled_further(problem, first.noise, found, workspace, rival=rival)
    return solution if likelihood(problem, first.noise, found) <= rival else continued(solution, found)
