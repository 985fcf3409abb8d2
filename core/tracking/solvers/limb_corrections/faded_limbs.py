"""Limbs of one of several performers that the images show less clearly for a moment: each is searched for by itself.

Where people pass each other, a limb may be led astray by somebody else. It then lies on another performer, or behind
its own, so that neither background nor uncovered foreground shows the error, and a limb is too small a part of a
performer for its cover to raise a doubt. But while it is astray, the images speak less for it than on the rest of its
way.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ....body.motion import Motion
from ....numerics.arrays import Array
from ....numerics.frame_ranges import runs
from ....runtime.timing import Seconds
from ..descent_stages import SETTLED, SETTLING
from ..equations.measurement import Workspace
from ..equations.problem import SegmentProblem, SegmentSolution
from ..gauss_newton import approach, continued, descend
from ..judgement.settled_solutions import SettledSolutions
from ..judgement.solution_ranking import RESTING_GAIN, likelihood
from ..limb_evidence.limb_likelihood import LimbOfPerformer, support_of_limbs
from .limb_search import freed_limb, is_elsewhere

FADED_RATIO = 0.5
"""Ratio of the support of a limb on a frame to its median over the segment, below which it has faded."""
MIN_DURATION = 0.1
"""Shorter intervals do not count, seconds."""
MAX_SEARCHES = 2
"""Most searches for one limb."""


def faded_limbs(problem: SegmentProblem, motions: Sequence[Motion]) -> list[LimbOfPerformer]:
    """Find the limbs whose support, the log likelihood ratio of the images with the limb where it is against without
    it, is low for a moment: the one that falls lowest first.

    Parameters
    ----------
    problem : SegmentProblem
    motions : sequence of Motion
        F poses per performer.
    """
    found = []
    long = max(2, int(np.ceil(MIN_DURATION * problem.fps)))
    for performer in problem.sought:
        for i, chain, _, shown in support_of_limbs(problem.alone(performer), motions):
            lowest = _lowest_support(shown(), long)
            if lowest < FADED_RATIO:
                found.append((lowest, (i, chain)))
    return [place for _, place in sorted(found, key=lambda one: one[0])]


def _lowest_support(support: Array, long: int) -> float:
    """Lowest mean of a limb's support (F,), relative to its median, over an interval of `long` frames or more on all of
    which it has faded; 1 if there is none.
    """
    usual = max(float(np.median(support)), 1e-9)
    faded = runs(support < FADED_RATIO * usual)
    means = [support[first : last + 1].mean() / usual for first, last in faded if last + 1 - first >= long]
    return float(min(means, default=1.0))


def with_faded_limbs_found(problem: SegmentProblem, solution: SegmentSolution, workspace: Workspace) -> SegmentSolution:
    """Search for each limb that has faded, and take over what makes the images likelier.

    The performer is solved further from what was found, and from the motion as it was, with the motions of the others
    given. If any limb was found, all are solved together at the end.

    Parameters
    ----------
    problem : SegmentProblem
    solution : SegmentSolution
    workspace : Workspace
    """
    motions, seconds = solution.motions, Seconds(solution.seconds)
    settled = SettledSolutions()
    for turn in range(MAX_SEARCHES):
        places, before = faded_limbs(problem, motions), motions
        for k, place in enumerate(places):
            share = (turn + k / len(places)) / MAX_SEARCHES, (turn + (k + 1) / len(places)) / MAX_SEARCHES
            with seconds.measure("initial solution"):
                own = replace(solution, motions=motions)
                motions = _with_limb_found(problem, own, place, turn, settled=settled, workspace=workspace.part(*share))
        if motions is before:
            break
    if motions is solution.motions:
        return replace(solution, seconds=seconds)
    ended = descend(problem, motions, workspace.silent(), SETTLED)
    seconds.add(ended.seconds)
    return replace(continued(solution, ended), seconds=seconds)


def _with_limb_found(
    problem: SegmentProblem,
    solution: SegmentSolution,
    place: LimbOfPerformer,
    seed: int,
    *,
    settled: SettledSolutions,
    workspace: Workspace,
) -> tuple[Motion, ...]:
    """Search for one limb and return the likelier motions, with it elsewhere or as they were.

    A limb that returns to where it was, or to where a descent would have led it by itself, is right there. What else
    has changed then is chance: the likelihood may have risen because of another limb, which was led astray.
    """
    i, chain = place
    alone, body, motions = problem.alone(i), problem.bodies[i], solution.motions
    found = freed_limb(alone, motions, place, seed)
    if not is_elsewhere(body, chain, motions[i], found):
        return motions
    begin = (*motions[:i], found, *motions[i + 1 :])
    settling, *_ = approach(alone, begin, workspace.part(0.0, 0.3), SETTLING)
    if not is_elsewhere(body, chain, motions[i], settling[i]):
        return motions
    kept = settled.after(alone, replace(solution, only=alone.only), workspace.part(0.3, 0.6))
    there = descend(alone, settling, workspace.part(0.6, 1.0), SETTLED, kept.noise)
    gain = likelihood(alone, kept.noise, there) - likelihood(alone, kept.noise, kept.solution)
    likelier = gain > RESTING_GAIN and is_elsewhere(body, chain, kept.solution.motions[i], there.motions[i])
    return there.motions if likelier else motions
