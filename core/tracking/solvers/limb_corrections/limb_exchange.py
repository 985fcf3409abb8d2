"""Exchanging limbs between solutions, or left with right, where that makes the images likelier."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import islice

import numpy as np

from ....body.limbs import limb_pairs
from ....body.motion import with_motion
from ....runtime.timing import Seconds
from ..approach import approach
from ..assessment.solution_ranking import (
    RESTING_GAIN,
    likeliest_at_rest,
    likelihood,
    likelihood_decides,
    nearly_equal,
    never_likelier,
    noise_at,
    same_solution,
    settled_further,
)
from ..descent_stages import SETTLED, SETTLING
from ..equations.measurement import Workspace
from ..equations.problem import SegmentProblem, SegmentSolution
from ..equations.segment_equations import SegmentNoise
from ..gauss_newton import continued, descend
from .local_trials import LocalTrial
from .swapped_limbs import Exchange, Swap, exchanges, swaps

LENDER_TOLERANCE = 0.03
"""Relative difference of cover up to which a solution may lend its limbs to the best one."""


def recombined(
    problem: SegmentProblem,
    best: SegmentSolution,
    others: Sequence[SegmentSolution],
    noise: SegmentNoise,
    workspace: Workspace,
) -> SegmentSolution:
    """Take over pairs of limbs from other solutions into the best one where that makes the images likelier.

    The random search may find the arms in one solution and the legs in another. A limb does not quite fit the trunk of
    another solution, so each mixture is solved further before it is compared.

    Parameters
    ----------
    problem : SegmentProblem
    best : SegmentSolution
    others : sequence of SegmentSolution
    noise : SegmentNoise
        All are compared under this noise.
    workspace : Workspace
    """
    lenders = nearly_equal(others, LENDER_TOLERANCE)
    tried = [solution.motions for solution in lenders]
    places = [(i, left + right) for i in problem.sought for left, right in limb_pairs(problem.bodies[i])]
    for k, (i, parts) in enumerate(places):
        share = workspace.part(k / len(places), (k + 1) / len(places))
        mixtures = []
        for a, b in [pair for other in lenders for pair in ((best, other), (other, best))]:
            lent = a.motions[i].with_parts(parts, b.motions[i])
            motions = with_motion(a.motions, i, lent)
            if not any(same_solution(problem, motions, before) for before in tried):
                tried.append(motions)
                mixtures.append(motions)
        found = [best]
        for n, motions in enumerate(mixtures):
            part = share.part(n / len(mixtures), (n + 1) / len(mixtures))
            found.append(descend(problem, motions, part, SETTLED, noise).without_equations())
        best = likeliest_at_rest(problem, noise, *found, workspace=workspace)
    return best


def with_limbs_exchanged(problem: SegmentProblem, best: SegmentSolution, workspace: Workspace) -> SegmentSolution:
    """Exchange left and right limbs of the performer that is solved for between two of their meetings, where that is
    better.

    Legs that pass each other twice between two key poses look much as if they had turned back both times. A search for
    one limb at a time does not find this error, as the other limb is in its place. Among several performers, the
    solution is only solved further to be compared with an exchange that may be better, and stays as it was where no
    exchange counts.
    """
    noise = noise_at(problem, best, workspace)
    count = len(list(exchanges(problem, best.motions)))
    rest = _Rest(problem, noise, workspace)
    if count > 0 and problem.only is None:
        best = rest.of(best)
    kept = best
    for k in range(count):
        part = workspace.part(k / count, (k + 1) / count)
        # Generated anew from the best so far: an accepted exchange leaves the meetings of the limbs where they were.
        for exchange in islice(exchanges(problem, best.motions), k, k + 1):
            found = _exchange_tried(problem, best, exchange, rest, part)
            if found is None:
                continue
            best = rest.of(best)
            if _exchange_counts(problem, best, found, noise):
                best = kept = rest.known = continued(best, found)
    return kept


def _with_mistaken_limbs_exchanged(
    problem: SegmentProblem, best: SegmentSolution, workspace: Workspace
) -> SegmentSolution:
    """Exchange limbs of one of several performers after the other, with the motions of the others given; if any were
    exchanged, all are solved together at the end.
    """
    seconds, motions = Seconds(best.seconds), best.motions
    with seconds.measure("initial solution"):
        for i in problem.sought:
            alone = problem.alone(i)
            if any(True for _ in exchanges(alone, motions)):
                begin = replace(best, motions=motions, only=alone.only)
                motions = with_limbs_exchanged(alone, begin, workspace.silent()).motions
    if motions is best.motions:
        return best
    found = descend(problem, motions, workspace, SETTLED)
    seconds.add(found.seconds)
    return replace(continued(best, found), seconds=dict(seconds), doubted=best.doubted)


def with_crossed_limbs_exchanged(
    problem: SegmentProblem, best: SegmentSolution, workspace: Workspace
) -> SegmentSolution:
    """Exchange the places of limbs of a performer that reach across each other, where that is better.

    Legs that pass each other may have followed each other's pictures so well that nothing contradicts the solution. It
    is done in several views only: a single one does not show which limb is in front. Limbs of one of several performers
    are also exchanged where that hardly makes their motion rougher (`exchanges`).

    Parameters
    ----------
    problem : SegmentProblem
    best : SegmentSolution
    workspace : Workspace
    """
    if not problem.shows_depth:
        return best
    if problem.among_others:
        return _with_mistaken_limbs_exchanged(problem, best, workspace)
    crossed = [swap for swap in swaps(problem, best.motions) if swap.reaches_across(problem, best.motions)]
    if not crossed:
        return best
    seconds = Seconds(best.seconds)
    with seconds.measure("initial solution"):
        kept = _with_places_exchanged(problem, best, crossed, workspace)
    return replace(kept, seconds=dict(seconds), doubted=best.doubted)


def _with_places_exchanged(
    problem: SegmentProblem, best: SegmentSolution, crossed: Sequence[Swap], workspace: Workspace
) -> SegmentSolution:
    noise = noise_at(problem, best, workspace)
    rest = _Rest(problem, noise, workspace)
    kept, settled = best, rest.of(best)
    for swap in crossed:
        exchange = Exchange(swap.of_places(problem, settled.motions), places=True)
        found = _exchange_tried(problem, settled, exchange, rest, workspace)
        if found is not None and _exchange_counts(problem, settled, found, noise):
            kept = settled = rest.known = continued(settled, found)
    return kept


class _Rest:
    """Solves a solution further, once, when an exchange is to be compared with it."""

    def __init__(
        self, problem: SegmentProblem, noise: SegmentNoise, workspace: Workspace, known: SegmentSolution | None = None
    ) -> None:
        self.noise, self.known = noise, known
        self._problem, self._workspace = problem, workspace

    def of(self, best: SegmentSolution) -> SegmentSolution:
        """Return the best solution so far, solved further."""
        if self.known is None:
            further = descend(self._problem, best.motions, self._workspace.silent(), SETTLED, self.noise)
            self.known = continued(best, further)
        return self.known


def _exchange_counts(
    problem: SegmentProblem, best: SegmentSolution, found: SegmentSolution, noise: SegmentNoise
) -> bool:
    """Whether a solution with exchanged limbs is better than the one without.

    The likelihood decides: limbs that have only just been exchanged are still a few centimetres off and may cover less,
    and so may a limb that is rightly hidden by another performer. Where a single moving camera leaves it open
    (`likelihood_decides`), the exchange must cover more at a lower cost.
    """
    if not likelihood_decides(problem):
        return found.cover > best.cover and found.energy[-1] < best.energy[-1]
    return likelihood(problem, noise, found) > likelihood(problem, noise, best) + RESTING_GAIN


def _exchange_tried(
    problem: SegmentProblem, best: SegmentSolution, exchange: Exchange, rest: _Rest, workspace: Workspace
) -> SegmentSolution | None:
    """Solve from exchanged limbs; None if the exchange does not count.

    For a single performer it is tried on the frames beside it first, where these are few.
    """
    noise = rest.noise
    local = LocalTrial.around(problem, noise, best.motions, exchange.motions) if problem.only is None else None
    if local is None:
        return _exchange_settled(problem, best, exchange, rest, workspace)
    there = descend(local.problem, local.of(best.motions), workspace, SETTLED, local.noise)
    here = replace(exchange, motions=local.of(exchange.motions))
    found = _exchange_settled(
        local.problem, there, here, _Rest(local.problem, local.noise, workspace, there), workspace
    )
    if found is None or not _exchange_counts(local.problem, there, found, local.noise):
        return None
    return descend(problem, local.within(best.motions, found.motions), workspace, SETTLED, noise)


def _exchange_settled(
    problem: SegmentProblem, best: SegmentSolution, exchange: Exchange, rest: _Rest, workspace: Workspace
) -> SegmentSolution | None:
    """Solve from exchanged limbs. For one of several performers, only while it could still become likelier than without
    the exchange (`never_likelier`).

    For a single performer it is solved until it is at rest, or cannot become likelier than without the exchange: limbs
    that do not quite meet where they are exchanged take long to get there. From each other's places, coarse steps would
    lead limbs away again, as the trunk is still where the wrong limbs have drawn it.
    """
    motions, noise = exchange.motions, rest.noise
    if problem.only is None:
        rival = likelihood(problem, noise, best) + RESTING_GAIN if likelihood_decides(problem) else -np.inf
        stages = SETTLED if exchange.places else (*SETTLING, *SETTLED)
        found = descend(problem, motions, workspace, stages, noise)
        return settled_further(problem, noise, found, workspace, rival=rival)
    if not exchange.places:
        motions = approach(problem, motions, workspace.part(0.0, 0.3), SETTLING).motions
    vain = None
    if likelihood_decides(problem):
        vain = never_likelier(problem, noise, likelihood(problem, noise, rest.of(best)) + RESTING_GAIN)
    return descend(problem, motions, workspace.part(0.3, 1.0), SETTLED, noise, hopeless=vain)
