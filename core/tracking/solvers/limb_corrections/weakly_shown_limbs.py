"""Limbs of a single performer that the images show less clearly than on the key poses, and that may therefore be lost.

A limb that is lost in front of the body, or along the line of sight of one of two cameras, covers foreground, leaves
hardly any uncovered, and is too small a part of the performer for its cover to raise a doubt. But its pixels and its
sides speak less for it than where the key poses have it. That alone does not show that it is lost: others are hidden
for a while. So it is searched for alone, once around an even path between the key poses, and once around its present
motion; before that together with its counterpart (`limb_pairs_elsewhere`), if that is shown as weakly.
Mostly a limb that is right is found where it was, which costs little; otherwise the likelier solution is kept.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

import numpy as np

from ....body.limbs import limb_pairs
from ....body.motion import Motion
from ....numerics.arrays import Array, Ints
from ..descent_stages import SETTLED
from ..equations.measurement import Workspace
from ..equations.problem import SegmentProblem, SegmentSolution
from ..gauss_newton import descend
from ..judgement.settled_solutions import SettledSolutions
from ..judgement.solution_doubts import MIN_DURATION
from ..limb_evidence.limb_likelihood import LimbOfPerformer, SupportOfLimb, least_supported, support_of_limbs
from ..thinned_frames import ThinnedProblem
from .limb_pairs_elsewhere import with_pairs_found
from .limb_search import is_elsewhere
from .limbs_elsewhere import LEAST_GAIN, found_across, found_elsewhere, likelier, likelier_with_limb, solved_from
from .search_rounds import MAX_SEARCH_ROUNDS

WEAK_RATIO = 0.7
"""Ratio of the support of a limb, in the mean over `MIN_DURATION`, to its support on the key poses, below which it is
searched for."""


def with_weakly_shown_limbs_found(
    problem: SegmentProblem,
    solution: SegmentSolution,
    known: SettledSolutions,
    workspace: Workspace,
    support: Iterable[SupportOfLimb] | None = None,
) -> SegmentSolution:
    """Search for the limbs of a single performer that the images show less clearly than on the key poses.

    Where frames follow each other closely, limbs are searched for on some of them (`thinned_frames`), and what is found
    there is solved for on all.

    Parameters
    ----------
    problem : SegmentProblem
        Of one performer in several views.
    solution : SegmentSolution
    known : SettledSolutions
        Shared by the searches for all limbs.
    workspace : Workspace
    support : iterable of SupportOfLimb, optional
        Of this solution's motions, if it is known.
    """
    places = weakly_shown_limbs(problem, solution.motions, support)
    thinned = ThinnedProblem.of(problem, solution.motions) if places else None
    if thinned is None:
        return _with_limbs_found(problem, solution, places, known, workspace)
    inner = thinned.workspace(workspace)
    few = descend(thinned.problem, thinned.of_motions(solution.motions), inner, SETTLED)
    found = _with_limbs_found(thinned.problem, few, places, SettledSolutions(), inner)
    if found.motions is few.motions:
        return solution
    settled = known.after(problem, solution, workspace)
    there = solved_from(problem, thinned.interpolated(found.motions), settled.noise, workspace)
    return likelier(problem, solution, settled, there, workspace, least_gain=LEAST_GAIN)


def _with_limbs_found(
    problem: SegmentProblem,
    solution: SegmentSolution,
    places: Sequence[LimbOfPerformer],
    known: SettledSolutions,
    workspace: Workspace,
) -> SegmentSolution:
    """Search for some limbs, pairs first."""
    weak = [pair for pair in limb_pairs(problem.bodies[0]) if all((0, chain) in places for chain in pair)]
    solution = with_pairs_found(problem, solution, weak, known, workspace, least_gain=LEAST_GAIN)
    for place in places:
        for turn in range(MAX_SEARCH_ROUNDS):
            before = solution.motions
            solution = _with_limb_found(problem, solution, place, turn, known=known, workspace=workspace)
            if solution.motions is before:
                break
    return solution


def _with_limb_found(
    problem: SegmentProblem,
    solution: SegmentSolution,
    place: LimbOfPerformer,
    turn: int,
    *,
    known: SettledSolutions,
    workspace: Workspace,
) -> SegmentSolution:
    """Return the first solution that is likelier with a limb elsewhere; the same one if there is none.

    What is likelier with the limb where it was, as near as a descent reaches, does not count: that is chance.
    """
    i, chain = place
    for found in _proposals(problem, solution.motions, place, turn):
        settled = known.after(problem, solution, workspace)
        likelier = likelier_with_limb(
            problem, solution, settled, place, found, workspace=workspace, least_gain=LEAST_GAIN
        )
        if is_elsewhere(problem.bodies[i], chain, solution.motions[i], likelier.motions[i]):
            return likelier
    return solution


def _proposals(
    problem: SegmentProblem, motions: Sequence[Motion], place: LimbOfPerformer, turn: int
) -> Iterator[Motion]:
    """Generate the motions with a limb where it is found elsewhere: around an even path, and around its present one."""
    across = found_across(problem, motions, place)
    if across is not None:
        yield across[place[0]]
    around = found_elsewhere(problem, motions, place, turn)
    if around is not None:
        yield around


def weakly_shown_limbs(
    problem: SegmentProblem, motions: Sequence[Motion], support: Iterable[SupportOfLimb] | None = None
) -> list[LimbOfPerformer]:
    """Find the limbs that the images show less clearly for a moment than on the key poses (`WEAK_RATIO`), the weakest
    first.

    Parameters
    ----------
    problem : SegmentProblem
    motions : sequence of Motion
        F poses per performer.
    support : iterable of SupportOfLimb, optional
        Of these motions, if it is known.
    """
    long = max(2, int(np.ceil(MIN_DURATION * problem.fps)))
    support = support_of_limbs(problem, motions) if support is None else support
    return least_supported(support, lambda i, shown: weakest_support(shown, problem.whole_keys(i), long), WEAK_RATIO)


def weakest_support(support: Array, keys: Ints, long: int) -> float:
    """Least mean of a limb's support (F,) over `long` frames, relative to that on the key poses, interpolated between
    them; 1 without key poses, or with fewer frames.
    """
    if not len(keys) or len(support) < long:
        return 1.0
    usual = np.maximum(np.interp(np.arange(len(support)), keys, support[keys]), 1e-9)
    return float(np.convolve(support / usual, np.full(long, 1 / long), "valid").min())
