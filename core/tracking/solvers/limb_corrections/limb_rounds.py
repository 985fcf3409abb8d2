"""Searching for one limb round after round: each begins where the one before ended, as a limb that moves fast is not
reached in one.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from ....body.motion import with_motion
from .. import gauss_newton
from ..equations.measurement import Workspace
from ..equations.problem import SegmentProblem, SegmentSolution
from ..judgement.settled_solutions import SettledSolution, SettledSolutions
from ..judgement.solution_ranking import RESTING_GAIN, likeliest_at_rest, likelihood
from ..limb_evidence.limb_likelihood import LimbOfPerformer
from .limb_search import views_of
from .limbs_elsewhere import LEAST_GAIN, found_across, found_elsewhere, leads_elsewhere, solved_from
from .search_rounds import MAX_SEARCH_ROUNDS, MAX_VAIN_ROUNDS

MAX_RETURNS = 2
"""Rounds of the search in a row after which a limb is where it was, and the search ends: it is right there. With
several performers one is enough."""


def with_limb_regained(
    problem: SegmentProblem,
    solution: SegmentSolution,
    place: LimbOfPerformer,
    workspace: Workspace,
    known: SettledSolutions | None = None,
) -> SegmentSolution:
    """Search for one limb of a solution and return the likeliest result, which may be the solution itself.

    Parameters
    ----------
    problem : SegmentProblem
    solution : SegmentSolution
    place : LimbOfPerformer
    workspace : Workspace
    known : SettledSolutions, optional
        Shared by the searches for all limbs.
    """
    alone, known = problem.alone(place[0]), known or SettledSolutions()

    def settled() -> SettledSolution:
        return known.after(alone, solution, workspace.silent())

    if problem.among_others:
        tried = _tried_among_others(alone, solution, place, settled=settled, workspace=workspace)
    else:
        tried = _tried_alone(alone, place, settled=settled, workspace=workspace)
    if not tried:
        return solution
    best = likeliest_at_rest(alone, settled().noise, settled().solution, *tried, workspace=workspace)
    if best is settled().solution:
        return solution
    if problem.among_others:
        gain = likelihood(alone, settled().noise, best) - likelihood(alone, settled().noise, settled().solution)
        return replace(solution, motions=best.motions) if gain > LEAST_GAIN else solution
    return gauss_newton.continued(solution, gauss_newton.refine(problem, best.motions, workspace.silent()))


def _tried_alone(
    problem: SegmentProblem, place: LimbOfPerformer, *, settled: Callable[[], SettledSolution], workspace: Workspace
) -> list[SegmentSolution]:
    """Search for a limb of a single performer round after round, until `MAX_RETURNS` in a row lead back, and return all
    that was found.

    Parameters
    ----------
    problem : SegmentProblem
    place : LimbOfPerformer
    settled : callable
        Returns the solution with which results are compared; the search begins around it.
    workspace : Workspace
    """
    noise, around, returned = settled().noise, settled().solution, 0
    across = found_across(problem, around.motions, place)
    tried = [] if across is None else [solved_from(problem, across, noise, workspace.silent())]
    around = max(around, *tried, key=lambda one: likelihood(problem, noise, one)) if tried else around
    for turn in range(MAX_SEARCH_ROUNDS):
        found = found_elsewhere(problem, around.motions, place, turn)
        there = None
        if found is not None:
            part = workspace.part(turn / MAX_SEARCH_ROUNDS, (turn + 1) / MAX_SEARCH_ROUNDS)
            there = solved_from(problem, with_motion(around.motions, place[0], found), noise, part)
        moved = there is not None and leads_elsewhere(problem, place, around.motions, there.motions)
        if there is not None:
            tried.append(there)
            around = there
        returned = 0 if moved else returned + 1
        if returned == MAX_RETURNS:
            break
    return tried


def _tried_among_others(
    problem: SegmentProblem,
    solution: SegmentSolution,
    place: LimbOfPerformer,
    *,
    settled: Callable[[], SettledSolution],
    workspace: Workspace,
) -> list[SegmentSolution]:
    """Search for a limb of one of several performers round after round, and return what was found elsewhere.

    Where people pass, much is out of sight for good: the search ends with the first round that leads back, or after
    `MAX_VAIN_ROUNDS` in a row without a likelier solution. Parameters as in `_tried_alone`; the search begins around
    `solution`, as only what is found elsewhere makes settling worth its time.
    """
    around, most, vain = solution, -np.inf, 0
    tried: list[SegmentSolution] = []
    ratios = views_of(problem, solution.motions, place[0])  # the others stay where they are
    across = found_across(problem, solution.motions, place, ratios)
    if across is not None:
        noise = settled().noise
        tried.append(solved_from(problem, across, noise, workspace.silent()))
        around = max(settled().solution, *tried, key=lambda one: likelihood(problem, noise, one))
        most = likelihood(problem, noise, around)
    for turn in range(MAX_SEARCH_ROUNDS):
        found = found_elsewhere(problem, around.motions, place, turn, ratios)
        if found is None:
            break
        noise = settled().noise
        part = workspace.part(turn / MAX_SEARCH_ROUNDS, (turn + 1) / MAX_SEARCH_ROUNDS)
        there = solved_from(problem, with_motion(around.motions, place[0], found), noise, part)
        if not leads_elsewhere(problem, place, around.motions, there.motions):
            break
        if not tried:
            most = likelihood(problem, noise, settled().solution)
        tried.append(there)
        around, reached = there, likelihood(problem, noise, there)
        vain = 0 if reached > most + RESTING_GAIN else vain + 1
        most = max(most, reached)
        if vain == MAX_VAIN_ROUNDS:
            break
    return tried
