"""A limb that is found elsewhere: solved from there, and kept where that makes the images likelier."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ....body.motion import Motion, with_motion
from .. import gauss_newton
from ..descent_stages import SETTLED, UNCONVERGED_MOVE
from ..equations.measurement import Workspace
from ..equations.problem import SegmentProblem, SegmentSolution
from ..equations.segment_equations import SegmentNoise
from ..gauss_newton import descend, farthest_joint
from ..judgement.settled_solutions import SettledSolution
from ..judgement.solution_doubts import MIN_DURATION
from ..judgement.solution_ranking import RESTING_GAIN, likelihood, settled_further
from ..limb_evidence.limb_images import ViewRatios
from ..limb_evidence.limb_likelihood import LimbOfPerformer
from .bridges import evenly_led
from .limb_search import MIN_GAIN_ELSEWHERE, frames_elsewhere, freed_limb, is_elsewhere
from .local_trials import LocalTrial

LEAST_GAIN = 100.0
"""Smallest gain in log likelihood, in natural units, for which a limb is moved that only its pictures speak against, or
one of several performers: solving a limb that is right once more from elsewhere gains up to 60 by chance."""
_ACROSS_SEED = 1000
"""Draws other poses than the searches around the present motion."""


def found_elsewhere(
    alone: SegmentProblem,
    motions: Sequence[Motion],
    place: LimbOfPerformer,
    seed: int,
    ratios: Sequence[ViewRatios] | None = None,
) -> Motion | None:
    """Search for a limb once, and return the motion of its performer with the limb where it is found; None if that is
    where it was, as near as a descent reaches. With a single view, it reaches less far in depth.

    A limb of one of several performers is only elsewhere if the images say clearly more for it (`MIN_GAIN_ELSEWHERE`).
    `ratios` is what the views show of the performer, if it is known.
    """
    (i, chain), several = place, alone.among_others
    gain = MIN_GAIN_ELSEWHERE if several else -np.inf
    found = freed_limb(alone, motions, place, seed, ratios=ratios, least_gain=gain)
    if found is motions[i]:
        return None
    near = several or alone.shows_depth
    return None if near and not is_elsewhere(alone.bodies[i], chain, motions[i], found, least_frames(alone)) else found


def found_across(
    alone: SegmentProblem,
    motions: Sequence[Motion],
    place: LimbOfPerformer,
    ratios: Sequence[ViewRatios] | None = None,
) -> tuple[Motion, ...] | None:
    """Search for a limb around an even path between the key poses that hold it, and return the motions with the limb
    where it is found; None if that is where it was, as near as a descent reaches.

    What a search finds departs slowly from what it searches around. A limb that was lost within a few frames is not
    found from where it is now; the even path is far from the true one, but is nowhere left abruptly. With a single view
    this is not tried: the likelier of two motions is not the truer one often enough.
    """
    i, chain = place
    if not alone.shows_depth:
        return None
    led = with_motion(motions, i, evenly_led(alone, i, motions[i], chain))
    if led[i] is motions[i]:
        return None
    gain = MIN_GAIN_ELSEWHERE if alone.among_others else -np.inf
    found = freed_limb(alone, led, place, _ACROSS_SEED, ratios=ratios, least_gain=gain, before=motions[i])
    if found is led[i] and gain > 0:
        return None
    if not is_elsewhere(alone.bodies[i], chain, motions[i], found, least_frames(alone)):
        return None
    return with_motion(motions, i, found)


def least_frames(alone: SegmentProblem) -> int:
    """Return on how many frames in a row a limb must be elsewhere: the sampled poses of a single performer scatter."""
    return 1 if alone.among_others else max(2, round(MIN_DURATION * alone.fps))


def leads_elsewhere(
    alone: SegmentProblem, place: LimbOfPerformer, before: Sequence[Motion], after: Sequence[Motion]
) -> bool:
    """Whether a search has led to another motion: with several performers, of this limb, see `is_elsewhere`."""
    i, chain = place
    if alone.among_others:
        return is_elsewhere(alone.bodies[i], chain, before[i], after[i])
    return farthest_joint(alone, before, after) > UNCONVERGED_MOVE


def likelier_with_limb(
    problem: SegmentProblem,
    solution: SegmentSolution,
    settled: SettledSolution,
    place: LimbOfPerformer,
    found: Motion,
    *,
    workspace: Workspace,
    least_gain: float = RESTING_GAIN,
) -> SegmentSolution:
    """Return the solution with a limb of a single performer elsewhere if that is likelier, and otherwise as it is.

    Where the limb is elsewhere on few frames, it is tried on these and those beside them, while the motion of the
    others stays. Not with a single view, in which a limb that is found in the same place may have another depth.

    Parameters
    ----------
    problem : SegmentProblem
    solution : SegmentSolution
    settled : SettledSolution
        The same, solved further.
    place : LimbOfPerformer
    found : Motion
        The performer's motion with the limb elsewhere, from `found_elsewhere` around the settled solution.
    workspace : Workspace
    least_gain : float
        By how much it must raise the log likelihood of the images, natural units.
    """
    i, _ = place
    motions = settled.solution.motions
    if problem.shows_depth:
        moved = with_motion(motions, i, _elsewhere_alone(problem, motions[i], place, found))
        local = LocalTrial.around(problem, settled.noise, motions, moved)
        if local is not None:
            ways = (motions, moved)
            return _likelier_locally(
                problem, solution, ways, local, place=place, workspace=workspace, least_gain=least_gain
            )
    there = solved_from(problem, with_motion(motions, i, found), settled.noise, workspace)
    if leads_elsewhere(problem, place, motions, there.motions):
        rival = to_be_beaten(problem, settled, least_gain)
        there = settled_further(problem, settled.noise, there, workspace, rival=rival)
    return likelier(problem, solution, settled, there, workspace, least_gain=least_gain)


def _elsewhere_alone(problem: SegmentProblem, before: Motion, place: LimbOfPerformer, found: Motion) -> Motion:
    """Return the motion found, as it was before on all frames on which the limb is not elsewhere."""
    i, chain = place
    away = frames_elsewhere(problem.bodies[i], chain, before, found, least_frames(problem))
    return Motion(before.translations, np.where(away[:, None, None, None], found.rotations, before.rotations))


def _likelier_locally(
    problem: SegmentProblem,
    solution: SegmentSolution,
    ways: tuple[Sequence[Motion], Sequence[Motion]],
    local: LocalTrial,
    *,
    place: LimbOfPerformer,
    workspace: Workspace,
    least_gain: float,
) -> SegmentSolution:
    """Solve both ways, without and with the limb elsewhere, on a few frames; refine the second if it is likelier."""
    own, noise = local.problem, local.noise
    here, there = (solved_from(own, local.of(motions), noise, workspace) for motions in ways)
    least = likelihood(own, noise, here) + least_gain
    if leads_elsewhere(own, place, here.motions, there.motions):
        there = settled_further(own, noise, there, workspace, rival=least)
    if likelihood(own, noise, there) <= least:
        return solution
    return _refined(problem, solution, local.within(ways[0], there.motions), workspace)


def likelier(
    problem: SegmentProblem,
    solution: SegmentSolution,
    settled: SettledSolution,
    found: SegmentSolution,
    workspace: Workspace,
    *,
    least_gain: float = RESTING_GAIN,
) -> SegmentSolution:
    """Return a solution, or what was found beside it, refined, if that is likelier than the solution when settled."""
    if likelihood(problem, settled.noise, found) <= to_be_beaten(problem, settled, least_gain):
        return solution
    return _refined(problem, solution, found.motions, workspace)


def to_be_beaten(problem: SegmentProblem, settled: SettledSolution, least_gain: float = RESTING_GAIN) -> float:
    """Log likelihood of the images that another solution must exceed to take the place of a settled one."""
    return likelihood(problem, settled.noise, settled.solution) + least_gain


def solved_from(
    problem: SegmentProblem, motions: Sequence[Motion], noise: SegmentNoise, workspace: Workspace
) -> SegmentSolution:
    """Solve from motions; the result is only to be compared with others."""
    return descend(problem, motions, workspace, SETTLED, noise).without_equations()


def _refined(
    problem: SegmentProblem, solution: SegmentSolution, motions: Sequence[Motion], workspace: Workspace
) -> SegmentSolution:
    return gauss_newton.continued(solution, gauss_newton.refine(problem, motions, workspace))
