"""Limbs exchanged between solutions, or with each other, where the pictures are likelier with that."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import islice

from ...body.limbs import limb_pairs
from ...body.motion import Motion
from .descent_stages import SETTLED, SETTLING
from .gauss_newton import SegmentNoise, approach, continued, descend
from .like_limbs import exchanges
from .measurement import Workspace
from .problem import SegmentProblem, SegmentSolution
from .solution_ranking import RESTING, alike, cover_at, equals, likeliest_at_rest, likelihood, noise_of

LENDING = 0.03
"""A solution that covers less than the best by more than this share has no limbs to lend to it."""
HOPELESS = 0.06
"""Limbs of one of several performers that were exchanged, and cover less by this share once they have settled, do not
come to cover more."""


def recombined(
    problem: SegmentProblem,
    best: SegmentSolution,
    others: Sequence[SegmentSolution],
    noise: SegmentNoise,
    workspace: Workspace,
) -> SegmentSolution:
    """The best of some solutions, with like limbs taken from the others where that is likelier.

    What is drawn by chance may bring the arms to their places in one solution and the legs in another. Limbs do not
    fit a trunk that others have led, so they settle before they are compared. Of equals the
    likeliest counts; all are compared under one noise.
    """
    lenders = equals(others, LENDING)
    tried = [solution.motions for solution in lenders]
    places = [(i, left + right) for i in problem.sought for left, right in limb_pairs(problem.bodies[i])]
    for k, (i, parts) in enumerate(places):
        share = workspace.part(k / len(places), (k + 1) / len(places))
        mixtures = []
        for a, b in [pair for other in lenders for pair in ((best, other), (other, best))]:
            lent = a.motions[i].with_parts(parts, b.motions[i])
            motions = (*a.motions[:i], lent, *a.motions[i + 1 :])
            if not any(alike(motions, before) for before in tried):
                tried.append(motions)
                mixtures.append(motions)
        found = [best]
        for n, motions in enumerate(mixtures):
            part = share.part(n / len(mixtures), (n + 1) / len(mixtures))
            found.append(descend(problem, motions, part, SETTLED, noise))
        best = likeliest_at_rest(problem, noise, *found, workspace=workspace)
    return best


def with_limbs_exchanged(problem: SegmentProblem, best: SegmentSolution, workspace: Workspace) -> SegmentSolution:
    """The solution, with like limbs exchanged between their meetings where that covers more and is likelier.

    Legs that pass each other twice between two key poses look much as if they had turned back both times; looking for
    one limb at a time does not find that, as the other one is in its place. Performers take turns, each among the
    others as they are by then; where limbs of somebody were exchanged, all settle together at last.
    """
    if len(problem.sought) == 1:
        return _with_own_limbs_exchanged(problem, best, workspace)
    motions = best.motions
    for k, i in enumerate(problem.sought):
        part = workspace.part(k / len(problem.sought), (k + 1) / len(problem.sought))
        alone = problem.alone(i)
        own = replace(best, motions=motions, only=alone.only)
        motions = _with_own_limbs_exchanged(alone, own, part).motions
    if motions is best.motions:
        return best
    return continued(best, descend(problem, motions, workspace.silent(), SETTLED))


def _with_own_limbs_exchanged(problem: SegmentProblem, best: SegmentSolution, workspace: Workspace) -> SegmentSolution:
    """The same for the performer that is sought. What one of several has is settled on only for an exchange that may be
    better.
    """
    noise = noise_of(problem, best, workspace)
    count = len(list(exchanges(problem, best.motions)))
    settled = count > 0 and problem.only is None
    if settled:
        best = _settled_on(problem, best, noise, workspace)
    for k in range(count):
        part = workspace.part(k / count, (k + 1) / count)
        # Anew of what is best by now: an exchange that was accepted leaves the limbs meeting where they did.
        for motions in islice(exchanges(problem, best.motions), k, k + 1):
            found = _exchange_settled(problem, best, motions, noise, part)
            if found is None:
                continue
            if not settled:
                best, settled = _settled_on(problem, best, noise, workspace), True
            if _exchange_counts(problem, best, found, noise):
                best = continued(best, found)
    return best


def _settled_on(
    problem: SegmentProblem, best: SegmentSolution, noise: SegmentNoise, workspace: Workspace
) -> SegmentSolution:
    return continued(best, descend(problem, best.motions, workspace.silent(), SETTLED, noise))


def _exchange_counts(
    problem: SegmentProblem, best: SegmentSolution, found: SegmentSolution, noise: SegmentNoise
) -> bool:
    """Whether a solution with limbs exchanged is the better one. Of one of several performers the pictures' likelihood
    decides, which knows what it hides of the others; a limb that is hidden the right way may cover less.
    """
    if problem.only is None:
        return found.cover > best.cover and found.energy[-1] < best.energy[-1]
    return likelihood(problem, noise, found) > likelihood(problem, noise, best) + RESTING


def _exchange_settled(
    problem: SegmentProblem,
    best: SegmentSolution,
    motions: Sequence[Motion],
    noise: SegmentNoise,
    workspace: Workspace,
) -> SegmentSolution | None:
    """The solution from limbs that were exchanged; None for one of several performers if once the limbs have settled it
    covers so much less that the rest cannot make up for it.
    """
    if problem.only is None:
        return descend(problem, motions, workspace, (*SETTLING, *SETTLED), noise)
    settled, *_ = approach(problem, motions, workspace.part(0.0, 0.3), SETTLING)
    if cover_at(problem, best, settled, workspace) < best.cover - HOPELESS * abs(best.sought_cover):
        return None
    return descend(problem, settled, workspace.part(0.3, 1.0), SETTLED, noise)
