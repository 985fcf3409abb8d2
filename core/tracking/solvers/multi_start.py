"""Which start leads to the solution: the curve through the key poses, the motion followed from them, limbs looked for.

Gauss-Newton goes down to the nearest solution. Where the images disagree with the one below the curve, others are
tried, and the one that covers the most of what looks like the performers counts.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise

import numpy as np

from ...body.motion import Motion
from ...runtime.timing import Seconds
from .descent_stages import RESUMED, SETTLED, SETTLING, WINDOW
from .gauss_newton import SegmentNoise, approach, continued, descend
from .like_limbs import untangled_limbs
from .limb_exchange import recombined, with_limbs_exchanged
from .limb_search import found_limbs
from .measurement import Workspace
from .problem import AccelerationSearch, SegmentProblem, SegmentSolution
from .sequential_start import blended, excerpt, follow
from .solution_doubts import doubted_performers, doubtful, speaks_against, worst_first
from .solution_ranking import RESTING, alike, better, equals, likeliest_at_rest, likelihood, noise_of
from .strayed_limbs import with_limbs_returned

IN_SIGHT = 0.9
"""Share of a performer that others must leave in sight on all frames for its motion to be followed: a few frames show
too little of somebody who is passed to be followed by themselves."""
LOOKS = 5
"""How often limbs are looked for, at most."""
VAIN_LOOKS = 2
"""How many of them in turn may find nothing that covers as much as what is there."""
LimbSearch = Callable[[SegmentProblem, SegmentProblem, Sequence[Motion], int, Workspace], SegmentSolution]
"""See `look_for_limbs`."""


def best_of_starts(problem: SegmentProblem, start: Sequence[Motion], workspace: Workspace) -> SegmentSolution:
    """Fit the motion of all performers between their key poses.

    The curve through the key poses is one start. Each performer of whom it leaves a doubt is then solved by itself from
    other starts, among the others as they were found; see `best_of_own_starts`. At last all settle together, and like
    limbs are exchanged where that is better.
    Parameters as of `gauss_newton.descend`.
    """
    best = descend(problem, start, workspace.part(0.0, 0.2))
    seconds = Seconds(best.seconds)
    if problem.keypoints:
        with seconds.measure("initial solution"):
            best = with_limbs_returned(problem, start, best, workspace.silent())
    if problem.search is not AccelerationSearch.JOINTS:
        problem = problem.with_smoothness(best.variances)
    doubted = doubted_performers(problem, start, best) if problem.settings.limb_search else []
    motions = best.motions
    for k, i in enumerate(worst_first(problem, best, doubted)):
        own_start = [start[j] if j == i else motion for j, motion in enumerate(motions)]
        part = workspace.part(0.2 + 0.7 * k / len(doubted), 0.2 + 0.7 * (k + 1) / len(doubted))
        alone = problem.alone(i)
        before = replace(best, only=alone.only)
        if k:  # limbs of somebody else that were found may be what spoke against this performer
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
    if doubted and not problem.keypoints:  # keypoints show where limbs are
        # Of all performers: who stands before the one that is doubted may have had limbs exchanged for its.
        with seconds.measure("initial solution"):
            best = with_limbs_exchanged(problem, best, workspace.part(0.9, 1.0))
    return replace(best, seconds=seconds)


def resumed(problem: SegmentProblem, start: Sequence[Motion], workspace: Workspace) -> SegmentSolution | None:
    """The solution from a motion that was found before key poses changed; None where it leaves a doubt.

    Parameters as of `gauss_newton.descend`.
    """
    found = descend(problem, start, workspace, RESUMED)
    return None if doubted_performers(problem, start, found) else found


def best_of_own_starts(
    problem: SegmentProblem, start: Sequence[Motion], first: SegmentSolution, workspace: Workspace
) -> SegmentSolution:
    """The best of solutions from several starts: the motion is followed from the key poses, unless others hide the
    performer on the way, and then limbs are looked for around the solutions.

    Where only foreground beside the performer speaks against the first solution, one look tells whether its limbs can
    be there at all: it may be somebody else's.

    Parameters
    ----------
    problem : SegmentProblem
        Of one performer.
    start : sequence of Motion
    first : SegmentSolution
        The solution from there.
    workspace : Workspace

    Returns
    -------
    SegmentSolution
        Its seconds are those spent here.
    """
    seconds, solutions, [performer] = Seconds(), [first], problem.sought
    first_look = None
    looks = len(problem.whole_keys(performer)) > 1 and not problem.keypoints  # keypoints show where limbs are
    if looks and not speaks_against(problem, first):
        with seconds.measure("initial solution"):
            first_look = FirstLook.around(problem, first, workspace.part(0.0, 0.1))
        if not first_look.explains(problem):
            return replace(first, seconds=seconds)
    if not looks or first.unhidden[performer].min() > IN_SIGHT:
        with seconds.measure("initial solution"):
            initial = followed(problem, start, workspace.part(0.0, 0.15))
        solutions.append(descend(problem, initial, workspace.part(0.15, 0.25)))
        seconds.add(solutions[1].seconds)
    if looks:
        # Without a doubt an arm may still be lost: it is a small part of what is to be covered.
        with seconds.measure("initial solution"):
            best = searched(problem, start, solutions, workspace.part(0.25, 1.0), first_look=first_look)
    else:
        best = better(problem, *solutions)
    return replace(best, seconds=seconds)


@dataclass(frozen=True, eq=False)
class FirstLook:
    """One look for limbs around a solution, which tells whether others are worth it.

    Attributes
    ----------
    begin : SegmentSolution
        The solution.
    settled : SegmentSolution
        The same once it has settled as long as what was found.
    found : SegmentSolution
    noise : SegmentNoise
        At the solution; all were measured under it.
    """

    begin: SegmentSolution
    settled: SegmentSolution
    found: SegmentSolution
    noise: SegmentNoise

    @classmethod
    def around(cls, problem: SegmentProblem, solution: SegmentSolution, workspace: Workspace) -> FirstLook:
        """Look for limbs around a solution."""
        noise = noise_of(problem, solution, workspace)
        settled = descend(problem, solution.motions, workspace.silent(), SETTLED, noise)
        found = look_for_limbs(problem, problem, settled.motions, 0, workspace, noise=noise)
        return cls(solution, settled, found, noise)

    def explains(self, problem: SegmentProblem) -> bool:
        """Whether what was found makes the pictures likelier.

        A bystander's bare arm looks like the performer's, but other views do not show it where the performer's could
        be.
        """
        gain = likelihood(problem, self.noise, self.found) - likelihood(problem, self.noise, self.settled)
        return gain > RESTING and not alike(self.found.motions, self.settled.motions)


def searched(
    problem: SegmentProblem,
    start: Sequence[Motion],
    solutions: Sequence[SegmentSolution],
    workspace: Workspace,
    look: LimbSearch | None = None,
    *,
    first_look: FirstLook | None = None,
) -> SegmentSolution:
    """The solution from looking for limbs around some solutions, and then around the best until that has an equal.

    Of the solutions only equals of the best are looked around, or all where that is doubtful; they settle first, and
    those that lead to one motion are looked around once. While all are doubtful, limbs are also looked for around a
    trunk that moves as at the start, which limbs in wrong places have not led astray. It also ends after `VAIN_LOOKS`
    that cover clearly less than one of these solutions. The likeliest of all counts, see `likeliest_at_rest`, and
    exchanges limbs with the others, see `recombined`.
    `look` is how limbs are looked for, by default `look_for_limbs`; a first look that was taken around the best of the
    solutions is not taken again.
    """
    held = replace(problem, fixed=tuple(fixed | (np.arange(fixed.shape[1]) < 6) for fixed in problem.fixed))
    first = better(problem, *solutions)
    likely, noise = solutions if doubtful(problem, first) else equals(solutions), noise_of(problem, first, workspace)
    look = look or partial(look_for_limbs, noise=noise)
    looked = first_look if first_look is not None and first_look.begin is first else None
    settled = [
        descend(problem, solution.motions, workspace.silent(), SETTLED, noise)
        if looked is None or solution is not first
        else looked.settled
        for solution in likely
    ]
    begins: list[tuple[Sequence[Motion], SegmentProblem]] = []
    for solution in settled:
        if not any(alike(solution.motions, motions) for motions, _ in begins):
            begins.append((solution.motions, problem))
    found: list[SegmentSolution] = []
    looking, exchanging = workspace.part(0.0, 0.7), workspace.part(0.7, 1.0)
    while begins and len(found) < LOOKS:
        motions, around = begins.pop(0)
        part = looking.part(len(found) / LOOKS, (len(found) + 1) / LOOKS)
        if looked is not None and around is problem and motions is looked.settled.motions:
            found.append(looked.found)
            looked = None
        else:
            found.append(look(problem, around, motions, len(found), part))
        best = better(problem, *settled, *found)
        if not begins and doubtful(problem, best) and around is not held:
            begins.append((start, held))
        elif not begins and not _met(problem, best, [*settled, *found]) and (best in found or len(found) < VAIN_LOOKS):
            begins.append((best.motions, problem))
    best = likeliest_at_rest(problem, noise, better(problem, *settled), *settled, *found, workspace=workspace)
    return recombined(problem, best, [*settled, *found], noise, exchanging)


def _met(problem: SegmentProblem, best: SegmentSolution, solutions: Sequence[SegmentSolution]) -> bool:
    """Whether the best of some solutions has an equal, or one that leads to the same motion: what others leave in sight
    of one of several performers changes with every centimetre, and so does what it covers.
    """
    if len(equals(solutions)) > 1:
        return True
    others = [solution for solution in solutions if solution is not best]
    return problem.only is not None and any(alike(best.motions, other.motions) for other in others)


def look_for_limbs(
    problem: SegmentProblem,
    around: SegmentProblem,
    motions: Sequence[Motion],
    seed: int,
    workspace: Workspace,
    *,
    noise: SegmentNoise | None = None,
) -> SegmentSolution:
    """The solution from looking for limbs around motions, which settle first with what `around` has fixed."""
    begin = found_limbs(problem, motions, seed, workspace.part(0.0, 0.6))
    settled, *_ = approach(around, begin, workspace.part(0.6, 0.8), SETTLING)
    return descend(problem, untangled_limbs(problem, settled), workspace.part(0.8, 1.0), SETTLED, noise)


def followed(problem: SegmentProblem, start: Sequence[Motion], workspace: Workspace) -> list[Motion]:
    """The motion followed from the key poses of the performer that is sought to the next ones, or to the problem's
    ends.
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
    return descend(replace(problem, settings=without_prediction), start, workspace, WINDOW)
