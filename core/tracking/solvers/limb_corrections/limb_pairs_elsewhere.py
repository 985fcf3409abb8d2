"""Both limbs of a pair searched for at once: where both are lost, neither is found alone.

Arms that are lost in front of the trunk turn shoulders and trunk with them. If one of them is put right, the shoulders
cannot follow it while the other one holds them, and the images become less likely. So both are searched for, one after
the other, before the body is solved for, which then turns shoulders and trunk as well.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from ....body.motion import Motion, with_motion
from ..equations.measurement import Workspace
from ..equations.problem import SegmentProblem, SegmentSolution
from ..judgement.settled_solutions import SettledSolutions
from ..judgement.solution_ranking import RESTING_GAIN, likelihood, settled_further
from .bridges import evenly_led
from .limb_search import freed_limb, is_elsewhere
from .limbs_elsewhere import least_frames, likelier, solved_from, to_be_beaten
from .search_rounds import MAX_SEARCH_ROUNDS, MAX_VAIN_ROUNDS

LimbPair = tuple[list[int], list[int]]
"""Two limbs as chains of parts, see `core.body.limbs.limb_pairs`."""
POINTS_PER_PART = 48
"""Points of each part whose pixels are looked at, three times as many as for single limbs."""
_SEED = 2000
"""Draws other poses than the searches for single limbs."""


def with_pairs_found(
    problem: SegmentProblem,
    solution: SegmentSolution,
    pairs: Iterable[LimbPair],
    known: SettledSolutions,
    workspace: Workspace,
    *,
    least_gain: float = RESTING_GAIN,
) -> SegmentSolution:
    """Search for both limbs of some pairs round after round, and return the likeliest solution, which may be the given
    one.

    The first round searches around even paths between the key poses, the others around the likeliest motion so far.
    They end after `MAX_VAIN_ROUNDS` in a row without a likelier one, or with one that finds both limbs where they were.

    Parameters
    ----------
    problem : SegmentProblem
        Of one performer.
    solution : SegmentSolution
    pairs : iterable of tuple of lists of int
    known : SettledSolutions
        Shared by the searches for all limbs.
    workspace : Workspace
    least_gain : float
        By how much a pair elsewhere must raise the log likelihood of the images, natural units.
    """
    for pair in pairs:
        solution = _with_pair_found(problem, solution, pair, known, workspace=workspace, least_gain=least_gain)
    return solution


def _with_pair_found(
    problem: SegmentProblem,
    solution: SegmentSolution,
    pair: LimbPair,
    known: SettledSolutions,
    *,
    workspace: Workspace,
    least_gain: float,
) -> SegmentSolution:
    [performer], vain = problem.sought, 0
    settled = known.after(problem, solution, workspace)
    best = settled.solution
    for turn in range(1 + MAX_SEARCH_ROUNDS):
        found = _searched(problem, best.motions, pair, turn)
        if not _elsewhere(problem, pair, best.motions[performer], found):
            if turn:
                break
            continue
        there = solved_from(problem, with_motion(best.motions, performer, found), settled.noise, workspace.silent())
        gains = likelihood(problem, settled.noise, there) > likelihood(problem, settled.noise, best) + RESTING_GAIN
        best, vain = (there, 0) if gains else (best, vain + 1)
        if vain == MAX_VAIN_ROUNDS:
            break
    if best is settled.solution:
        return solution
    rival = to_be_beaten(problem, settled, least_gain)
    best = settled_further(problem, settled.noise, best, workspace, rival=rival)
    if not _elsewhere(problem, pair, settled.solution.motions[performer], best.motions[performer]):
        return solution
    return likelier(problem, solution, settled, best, workspace, least_gain=least_gain)


def _searched(problem: SegmentProblem, motions: Sequence[Motion], pair: LimbPair, turn: int) -> Motion:
    """Search for the limbs of a pair, one after the other; in the first turn around even paths of both."""
    [performer] = problem.sought
    motion = motions[performer]
    for chain in pair if turn == 0 else ():
        motion = evenly_led(problem, performer, motion, chain)
    for chain in pair:
        around = with_motion(motions, performer, motion)
        motion = freed_limb(problem, around, (performer, chain), _SEED + turn, points=POINTS_PER_PART)
    return motion


def _elsewhere(problem: SegmentProblem, pair: LimbPair, before: Motion, after: Motion) -> bool:
    [performer] = problem.sought
    body, least = problem.bodies[performer], least_frames(problem)
    return any(is_elsewhere(body, chain, before, after, least) for chain in pair)
