"""Solving from several starts: Gauss-Newton finds only the minimum nearest to its start.

The first start is the curve through the key poses. Where the images contradict its solution, three other kinds of
start are tried: the curve with another turn of the whole body (`whole_turns`), the motion followed frame by frame from
the key poses (`sequential_start`), and motions in which lost limbs were searched for in uncovered foreground
(`limb_search`). Solutions are compared by how much of the performer-like foreground they cover and how likely they make
the images (`solution_ranking`).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise

import numpy as np

from ...body.motion import Motion
from ...runtime.timing import Seconds
from .descent_stages import OUTLINE_REACH, RESUMED, SETTLED, SETTLING, WINDOW_STAGES
from .equations.measurement import Workspace
from .equations.problem import AccelerationSearch, SegmentProblem, SegmentSolution
from .equations.segment_equations import SegmentNoise
from .gauss_newton import approach, continued, descend, farthest_joint
from .limb_corrections.like_limbs import untangled_limbs
from .limb_corrections.limb_exchange import recombined, with_limbs_exchanged
from .limb_corrections.limb_search import found_limbs
from .limb_corrections.mirrored_limbs import with_limbs_mirrored
from .limb_corrections.strayed_limbs import with_limbs_returned
from .sequential_start import blended, excerpt, follow
from .settled_solutions import SettledSolution
from .solution_doubts import doubted_performers, explains_little, images_contradict, worst_first
from .solution_ranking import (
    RESTING_GAIN,
    covering_most,
    likeliest_at_rest,
    likelihood,
    nearly_equal,
    noise_at,
    same_solution,
)
from .whole_turns import with_whole_turn

MIN_FOLLOWED_SHARE = 0.9
"""Share of a performer that must be unhidden by others on every frame for its motion to be followed frame by frame: a
window of a few frames shows too little of somebody whom others pass in front of. Where less of any performer is
unhidden, limbs of all may have been led astray, see `faded_limbs`."""
MAX_SEARCH_ROUNDS = 5
"""Most rounds of the search for limbs."""
MAX_VAIN_ROUNDS = 2
"""Rounds in a row without a better solution after which the search ends."""
LimbSearch = Callable[[SegmentProblem, SegmentProblem, Sequence[Motion], int, Workspace], SegmentSolution]
"""See `look_for_limbs`."""


def best_of_starts(problem: SegmentProblem, start: Sequence[Motion], workspace: Workspace) -> SegmentSolution:
    """Solve for the motion of all performers between their key poses, from as many starts as the images call for.

    All performers are solved together from the curve through the key poses. Each performer for whom the images
    contradict that solution is then solved alone from other starts, with the motions of the others given
    (`best_of_own_starts`). Finally all are solved together again, and left and right limbs are exchanged where that is
    better. Parameters as in `gauss_newton.descend`.
    """
    best = descend(problem, start, workspace.part(0.0, 0.2))
    seconds = Seconds(best.seconds)
    if problem.keypoints:
        with seconds.measure("initial solution"):
            best = with_limbs_returned(problem, start, best, workspace.silent())
    if problem.search is not AccelerationSearch.JOINTS:
        problem = problem.with_smoothness(best.variances)
    doubted = doubted_performers(problem, start, best) if problem.settings.limb_search else []
    motions = straight = best.motions
    for k, i in enumerate(worst_first(problem, best, doubted)):
        own_start = [start[j] if j == i else motion for j, motion in enumerate(motions)]
        part = workspace.part(0.2 + 0.7 * k / len(doubted), 0.2 + 0.7 * (k + 1) / len(doubted))
        alone = problem.alone(i)
        before = replace(best, only=alone.only)
        if k:  # limbs of another performer, found since, may have been what contradicted this one
            before = descend(alone, motions, workspace.silent(), SETTLED)
            seconds.add(before.seconds)
            motions = before.motions
            if not doubted_performers(alone, own_start, before):
                continue
        own = best_of_own_starts(alone, own_start, before, part)
        seconds.add(own.seconds)
        motions = own.motions
        best = own if len(problem.bodies) == 1 else best
    if motions is not best.motions:
        settled = descend(problem, motions, workspace.silent(), SETTLED)
        seconds.add(settled.seconds)
        best = continued(best, settled)
    dispelled = len(problem.bodies) == 1 and motions is straight  # all foreground beside it is something else
    if doubted and not dispelled and not problem.keypoints:  # keypoints show where limbs are
        # For all performers: one who stands in front of a doubted performer may have taken over its limbs.
        with seconds.measure("initial solution"):
            best = with_limbs_exchanged(problem, best, workspace.part(0.9, 1.0))
    if problem.keypoints:
        with seconds.measure("initial solution"):
            best = with_limbs_mirrored(problem, best, workspace.silent())
    return replace(best, seconds=seconds, doubted=() if dispelled else tuple(doubted))


def resumed(
    problem: SegmentProblem, start: Sequence[Motion], workspace: Workspace, before: Sequence[Motion]
) -> SegmentSolution | None:
    """Solve from the motion that was found before key poses changed; None where the images contradict the result.

    Foreground beside the earlier motion was searched for limbs then. It does not count again, unless key poses moved
    farther than a descent reaches.

    Parameters as in `gauss_newton.descend`; `before` as in `protocol.Resume`.
    """
    found = descend(problem, start, workspace, RESUMED)
    searched = start if farthest_joint(problem, before, start) < OUTLINE_REACH else None
    return None if doubted_performers(problem, start, found, searched) else found


def best_of_own_starts(
    problem: SegmentProblem, start: Sequence[Motion], first: SegmentSolution, workspace: Workspace
) -> SegmentSolution:
    """Solve for one performer from several starts and return the best solution.

    The body may have turned the longer way round from one key pose to the next, which is tried first (`whole_turns`).
    The motion is followed frame by frame from the key poses, unless others hide the performer on the way; then limbs
    are searched for around the solutions. If nothing but uncovered foreground contradicts the first solution, and no
    whole turn is added to it, a single round of the search decides first whether the performer's limbs can be there at
    all: the foreground may be a bystander.

    Parameters
    ----------
    problem : SegmentProblem
        Of one performer, see `SegmentProblem.alone`.
    start : sequence of Motion
        F poses per performer.
    first : SegmentSolution
        The solution from that start.
    workspace : Workspace

    Returns
    -------
    SegmentSolution
        `seconds` is the time spent here.
    """
    seconds, [performer] = Seconds(), problem.sought
    first_look = None
    looks = len(problem.whole_keys(performer)) > 1 and not problem.keypoints  # keypoints show where limbs are
    if looks:
        with seconds.measure("initial solution"):
            start, first = with_whole_turn(problem, start, straight := first, workspace.part(0.0, 0.05))
    solutions = [first]
    if looks and first is straight and not images_contradict(problem, first):
        with seconds.measure("initial solution"):
            first_look = FirstLook.around(problem, first, workspace.part(0.0, 0.1))
        if not first_look.explains(problem):
            return replace(first, seconds=seconds)
    if not looks or first.unhidden[performer].min() > MIN_FOLLOWED_SHARE:
        with seconds.measure("initial solution"):
            initial = follow_both_ways(problem, start, workspace.part(0.0, 0.15))
        solutions.append(descend(problem, initial, workspace.part(0.15, 0.25)))
        seconds.add(solutions[1].seconds)
    if looks:
        # Even if the cover raises no doubt an arm may be lost: it is a small part of what is to be covered.
        with seconds.measure("initial solution"):
            best = searched(problem, start, solutions, workspace.part(0.25, 1.0), first_look=first_look)
    else:
        best = covering_most(problem, *solutions)
    return replace(best, seconds=seconds)


@dataclass(frozen=True, eq=False)
class FirstLook:
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
    def around(cls, problem: SegmentProblem, solution: SegmentSolution, workspace: Workspace) -> FirstLook:
        """Search for limbs around a solution."""
        settled = SettledSolution.after(problem, solution, workspace.silent())
        return cls(
            settled, look_for_limbs(problem, problem, settled.solution.motions, 0, workspace, noise=settled.noise)
        )

    def explains(self, problem: SegmentProblem) -> bool:
        """Whether the search found another motion that makes the images likelier.

        It does not for the bare arm of a bystander, which looks like the performer's: other views do not show it where
        the performer's arm could be.
        """
        noise, settled = self.settled.noise, self.settled.solution
        gain = likelihood(problem, noise, self.found) - likelihood(problem, noise, settled)
        return gain > RESTING_GAIN and not same_solution(self.found.motions, settled.motions)


def searched(
    problem: SegmentProblem,
    start: Sequence[Motion],
    solutions: Sequence[SegmentSolution],
    workspace: Workspace,
    look: LimbSearch | None = None,
    *,
    first_look: FirstLook | None = None,
) -> SegmentSolution:
    """Search for limbs around some solutions, and then around the best found, until two agree.

    1. The search begins around the solutions that cover as much as the best (`nearly_equal`), or around all of them if
    the
       best explains little. They are first solved a little further; those that then have the same motion count once.
    2. If the best still explains little, there is one search with the trunk held to its motion at the start, which
       misplaced limbs cannot have led astray.
    3. Further rounds search around the best so far. They end once the best has an equal, after `MAX_VAIN_ROUNDS` rounds
    that
       did not improve on the given solutions, or after `MAX_SEARCH_ROUNDS` rounds in all.

    For one of several performers, the rounds end with the first that found a better solution: where others are in the
    way, every solution explains little, and what is still lost is searched for limb by limb later.

    Of all solutions the likeliest is taken (`likeliest_at_rest`), with limbs of others where these are likelier
    (`recombined`).

    Parameters
    ----------
    problem : SegmentProblem
        Of one performer, or of all.
    start : sequence of Motion
        F poses per performer.
    solutions : sequence of SegmentSolution
    workspace : Workspace
    look : callable, optional
        One round of the search; by default `look_for_limbs`.
    first_look : FirstLook, optional
        The first round around the best of the solutions, if it was made already: it is not repeated.
    """
    held = replace(problem, fixed=tuple(fixed | (np.arange(fixed.shape[1]) < 6) for fixed in problem.fixed))
    first = covering_most(problem, *solutions)
    likely = solutions if explains_little(problem, first) else nearly_equal(solutions)
    noise = noise_at(problem, first, workspace)
    look = look or partial(look_for_limbs, noise=noise)
    looked = first_look if first_look is not None and first_look.settled.begin is first else None
    settled = [
        descend(problem, solution.motions, workspace.silent(), SETTLED, noise)
        if looked is None or solution is not first
        else looked.settled.solution
        for solution in likely
    ]
    begins: list[tuple[Sequence[Motion], SegmentProblem]] = []
    for solution in settled:
        if not any(same_solution(solution.motions, motions) for motions, _ in begins):
            begins.append((solution.motions, problem))
    found: list[SegmentSolution] = []
    looking, exchanging = workspace.part(0.0, 0.7), workspace.part(0.7, 1.0)
    while begins and len(found) < MAX_SEARCH_ROUNDS:
        motions, around = begins.pop(0)
        part = looking.part(len(found) / MAX_SEARCH_ROUNDS, (len(found) + 1) / MAX_SEARCH_ROUNDS)
        if looked is not None and around is problem and motions is looked.settled.solution.motions:
            found.append(looked.found)
            looked = None
        else:
            found.append(look(problem, around, motions, len(found), part))
        best = covering_most(problem, *settled, *found)
        if begins or (problem.only is not None and best in found):
            continue
        if explains_little(problem, best) and around is not held:
            begins.append((start, held))
        elif not _is_confirmed(problem, best, [*settled, *found]) and (best in found or len(found) < MAX_VAIN_ROUNDS):
            begins.append((best.motions, problem))
    best = likeliest_at_rest(problem, noise, covering_most(problem, *settled), *settled, *found, workspace=workspace)
    return recombined(problem, best, [*settled, *found], noise, exchanging)


def _is_confirmed(problem: SegmentProblem, best: SegmentSolution, solutions: Sequence[SegmentSolution]) -> bool:
    """Whether another solution covers as much as the best or, among several performers, has the same motion.

    Among several performers the visible area of one, and with it the cover, changes with every centimetre.
    """
    if len(nearly_equal(solutions)) > 1:
        return True
    others = [solution for solution in solutions if solution is not best]
    return problem.only is not None and any(same_solution(best.motions, other.motions) for other in others)


def look_for_limbs(
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
    settled, *_ = approach(around, begin, workspace.part(0.6, 0.8), SETTLING)
    return descend(problem, untangled_limbs(problem, settled), workspace.part(0.8, 1.0), SETTLED, noise)


def follow_both_ways(problem: SegmentProblem, start: Sequence[Motion], workspace: Workspace) -> list[Motion]:
    """Follow the motion frame by frame from each key pose to the next, forward and backward, and blend both.

    Before the first and after the last key pose of the performer that is solved for, there is one direction only.
    """
    keys = problem.whole_keys(problem.sought[0]).tolist()
    if not keys:
        return list(start)
    found, ends = list(start), sorted({0, *keys, problem.length - 1})
    for k, (first, last) in enumerate(pairwise(ends)):
        part = workspace.part(k / (len(ends) - 1), (k + 1) / (len(ends) - 1))
        directions = [backward for backward, end in ((False, first), (True, last)) if end in keys]
        here = [motion[first : last + 1] for motion in found]
        ways = [
            follow(
                excerpt(problem, first, last + 1),
                here,
                part.part(d / len(directions), (d + 1) / len(directions)),
                _solve_window,
                backward=backward,
            )
            for d, backward in enumerate(directions)
        ]
        new = blended(*ways) if len(ways) == 2 else ways[0]
        found = [motion.replaced(first, piece) for motion, piece in zip(found, new, strict=True)]
    return found


def _solve_window(problem: SegmentProblem, start: Sequence[Motion], workspace: Workspace) -> SegmentSolution:
    without_prediction = replace(problem.settings, prediction=False)
    return descend(replace(problem, settings=without_prediction), start, workspace, WINDOW_STAGES)
