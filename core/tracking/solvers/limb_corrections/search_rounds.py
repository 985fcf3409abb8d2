"""Rounds of the search for limbs: around the solutions so far, until two of what is found agree.

A round (`search_round`) finds limbs in uncovered foreground around a motion and solves from there. Which motion comes
next, and when the rounds end, is decided by how much the solutions so far explain (`searched`).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache, partial
from itertools import islice

import numpy as np

from ....body.motion import Motion
from ..approach import approach
from ..assessment.settled_solutions import SettledSolution
from ..assessment.solution_doubts import explains_little
from ..assessment.solution_ranking import (
    RESTING_GAIN,
    cover_at,
    covering_most,
    likeliest_at_rest,
    likelihood,
    nearly_equal,
    noise_at,
    same_solution,
)
from ..descent_stages import SETTLED, SETTLING
from ..equations.measurement import Workspace
from ..equations.problem import SegmentProblem, SegmentSolution
from ..equations.segment_equations import SegmentNoise
from ..gauss_newton import VainTest, descend
from .limb_exchange import recombined
from .limb_search import found_limbs
from .limbs_elsewhere import limbs_elsewhere
from .swapped_limbs import untangled_limbs

MAX_SEARCH_ROUNDS = 5
"""Most rounds of the search for limbs."""
MAX_VAIN_ROUNDS = 2
"""Rounds in a row without a better solution after which the search ends."""
MIN_START_SHARE = 0.25
"""Share of what the best solution covers that the start must cover for a round with the trunk held there: a curve that
covers next to nothing is no better place for the trunk."""
SearchRound = Callable[[SegmentProblem, SegmentProblem, Sequence[Motion], int, Workspace], SegmentSolution]
"""See `search_round`."""


@dataclass(frozen=True, eq=False)
class TrialRound:
    """A first round of the search for limbs around a solution, to see whether more are worth their time.

    Attributes
    ----------
    settled : SettledSolution
        The solution, and what it becomes in as many further iterations as `found` has had.
    found : SegmentSolution
        The result of the search, measured under the same noise.
    """

    settled: SettledSolution
    found: SegmentSolution

    @classmethod
    def around(cls, problem: SegmentProblem, settled: SettledSolution, workspace: Workspace) -> TrialRound:
        """Search for limbs around a solution."""
        motions = settled.solution.motions
        return cls(settled, search_round(problem, problem, motions, 0, workspace, noise=settled.noise))

    def explains(self, problem: SegmentProblem) -> bool:
        """Whether the search found another motion that makes the images likelier.

        It does not for the bare arm of a bystander, which looks like the performer's: other views do not show it where
        the performer's arm could be.
        """
        return self.gains(problem) and not same_solution(problem, self.found.motions, self.settled.solution.motions)

    def gains(self, problem: SegmentProblem) -> bool:
        """Whether the search made the images likelier, if only by a limb that was lost on a few frames."""
        found, settled = (likelihood(problem, self.settled.noise, one) for one in (self.found, self.settled.solution))
        return found > settled + RESTING_GAIN


def searched(
    problem: SegmentProblem,
    start: Sequence[Motion],
    solutions: Sequence[SegmentSolution],
    workspace: Workspace,
    search: SearchRound | None = None,
    *,
    trial: TrialRound | None = None,
    settled: SettledSolution | None = None,
) -> SegmentSolution:
    """Search for limbs around some solutions, and then around the best found, until two agree.

    1. The search begins around the solutions that cover as much as the best (`nearly_equal`), or around all of them if
       the best explains little. They are first solved a little further; those that then have the same motion count
       once.
    2. If the best still explains little, there is one round with the trunk held to its motion at the start, which
       misplaced limbs cannot have led astray, unless the start covers next to nothing (`MIN_START_SHARE`).
    3. Further rounds search around the best so far. They end once the best has an equal, after `MAX_VAIN_ROUNDS` rounds
       that did not improve on the given solutions, or after `MAX_SEARCH_ROUNDS` rounds in all.

    Of all solutions the likeliest is taken (`likeliest_at_rest`), with limbs of others where these are likelier
    (`recombined`).

    Parameters
    ----------
    problem : SegmentProblem
        Of a single performer.
    start : sequence of Motion
        F poses per performer.
    solutions : sequence of SegmentSolution
    workspace : Workspace
    search : callable, optional
        One round of the search; by default `search_round`.
    trial : TrialRound, optional
        The first round around the best of the solutions, if it was made already: it is not repeated.
    settled : SettledSolution, optional
        The best of the solutions, solved further, if it was already.
    """
    first = covering_most(problem, *solutions)
    likely = solutions if explains_little(problem, first) else nearly_equal(solutions)
    noise = noise_at(problem, first, workspace)
    known = trial if trial is not None and trial.settled.begin is first else None
    rested = _rested(problem, likely, settled if known is None else known.settled, noise, workspace)
    start_cover = cache(lambda: cover_at(problem, first, start, workspace))
    search = search or partial(search_round, noise=noise)
    searching, exchanging = workspace.part(0.0, 0.7), workspace.part(0.7, 1.0)
    found: list[SegmentSolution] = []
    for around, motions in islice(_begins(problem, start, rested, found, start_cover), MAX_SEARCH_ROUNDS):
        if known is not None and motions is known.settled.solution.motions and around is problem:
            found.append(known.found)
            known = None
        else:
            part = searching.part(len(found) / MAX_SEARCH_ROUNDS, (len(found) + 1) / MAX_SEARCH_ROUNDS)
            found.append(search(problem, around, motions, len(found), part))
    best = likeliest_at_rest(problem, noise, covering_most(problem, *rested), *rested, *found, workspace=workspace)
    return recombined(problem, best, [*rested, *found], noise, exchanging)


def _rested(
    problem: SegmentProblem,
    solutions: Sequence[SegmentSolution],
    settled: SettledSolution | None,
    noise: SegmentNoise,
    workspace: Workspace,
) -> list[SegmentSolution]:
    """Return solutions, solved a little further; one of them may be already."""
    return [
        settled.solution
        if settled is not None and solution is settled.begin
        else descend(problem, solution.motions, workspace.silent(), SETTLED, noise).without_equations()
        for solution in solutions
    ]


def _begins(
    problem: SegmentProblem,
    start: Sequence[Motion],
    rested: Sequence[SegmentSolution],
    found: Sequence[SegmentSolution],
    start_cover: Callable[[], float],
) -> Iterator[tuple[SegmentProblem, Sequence[Motion]]]:
    """Generate the problem, maybe with the trunk held, and the motions around which each round searches; see
    `searched`. What the rounds so far have found must be in `found` whenever the next is asked for.
    """
    for motions in _distinct_motions(problem, rested):
        yield problem, motions
    held = replace(problem, fixed=tuple(fixed | (np.arange(fixed.shape[1]) < 6) for fixed in problem.fixed))
    around = problem
    while True:
        best = covering_most(problem, *rested, *found)
        if around is not held and explains_little(problem, best) and start_cover() > MIN_START_SHARE * best.cover:
            around, motions = held, start
        elif len(nearly_equal([*rested, *found])) == 1 and (best in found or len(found) < MAX_VAIN_ROUNDS):
            around, motions = problem, best.motions
        else:
            return
        yield around, motions


def searched_among_others(
    problem: SegmentProblem, first: SegmentSolution, seed: int, workspace: Workspace
) -> SegmentSolution:
    """Search once for the limbs of one of several performers that are hardly seen where they are, and solve from where
    they are found; what is still lost is searched for limb by limb later. If that leads all of them back to where they
    were, the first solution stands; in a single view, which hardly shows how far away they are, the likelier one does.
    Parameters as in `searched`; the seed selects the random poses.
    """
    begin = found_limbs(problem, first.motions, seed, workspace.part(0.0, 0.4))
    if all(found is motion for found, motion in zip(begin, first.motions, strict=True)):
        return first
    noise = noise_at(problem, first, workspace)

    def back(motions: Sequence[Motion]) -> bool:
        return problem.shows_depth and not limbs_elsewhere(problem, first.motions, motions)

    found = _solved_from(problem, problem, begin, workspace.part(0.4, 0.8), noise, vain=back)
    if back(found.motions):
        return first
    rested = descend(problem, first.motions, workspace.silent(), SETTLED, noise).without_equations()
    best = likeliest_at_rest(problem, noise, rested, found, workspace=workspace)
    return recombined(problem, best, [rested, found], noise, workspace.part(0.8, 1.0))


def _distinct_motions(problem: SegmentProblem, solutions: Sequence[SegmentSolution]) -> list[Sequence[Motion]]:
    """Return the motions of solutions, without those that are the same as an earlier one's (`same_solution`)."""
    kept: list[Sequence[Motion]] = []
    for solution in solutions:
        if not any(same_solution(problem, solution.motions, motions) for motions in kept):
            kept.append(solution.motions)
    return kept


def search_round(
    problem: SegmentProblem,
    around: SegmentProblem,
    motions: Sequence[Motion],
    seed: int,
    workspace: Workspace,
    *,
    noise: SegmentNoise | None = None,
) -> SegmentSolution:
    """Make one round of the search for limbs, and solve from the poses that it finds.

    Parameters
    ----------
    problem : SegmentProblem
        Used by the last iterations.
    around : SegmentProblem
        The same with those degrees of freedom fixed that must not follow misplaced limbs; used by the first iterations.
    motions : sequence of Motion
        F poses per performer, around which limbs are searched for.
    seed : int
        Selects the random poses.
    workspace : Workspace
    noise : SegmentNoise, optional
        Of the measurements in the last iterations; by default as measured at their start.
    """
    begin = found_limbs(problem, motions, seed, workspace.part(0.0, 0.6))
    return _solved_from(problem, around, begin, workspace.part(0.6, 1.0), noise)


def _solved_from(
    problem: SegmentProblem,
    around: SegmentProblem,
    begin: Sequence[Motion],
    workspace: Workspace,
    noise: SegmentNoise | None,
    *,
    vain: VainTest | None = None,
) -> SegmentSolution:
    settled = approach(around, begin, workspace.part(0.0, 0.5), SETTLING).motions
    found = descend(problem, untangled_limbs(problem, settled), workspace.part(0.5, 1.0), SETTLED, noise, vain=vain)
    return found.without_equations()
