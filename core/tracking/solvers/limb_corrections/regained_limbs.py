"""Searching again for limbs once a segment is solved and the motion beside it is known.

These signs show that a limb is lost, even in front of the body, where it covers foreground and so seems right:

- Its velocity changes abruptly at a key pose. The performer knows nothing of the frames that the animator chose, so a
  fist that moves steadily up to a key pose and turns away exactly there has been lost on one side of it.
- Brightness does not change across its sides as on key poses, or its pixels look as if it were not there.
- The images show it less clearly for a moment: where performers hide one another, than for most of the time
  (`faded_limbs`); of a single performer in several views, than on the key poses (`weakly_shown_limbs`).

Others show no sign. If the images contradicted the first solution of a single performer, the whole body is therefore
led out of its minimum once, and its limbs are searched for, one by one and in pairs (`limb_pairs_elsewhere`).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from functools import cache, partial

import numpy as np

from ....body import part_poses
from ....body.limbs import limb_pairs, limbs
from ....body.motion import Motion, stacked
from ....body.smoothness import second_differences
from ....evidence.occlusion import LONG_GAP
from ....numerics.arrays import Array
from ....runtime.timing import Seconds
from ..descent_stages import COARSE_RESTART, SETTLED, UNCONVERGED_MOVE
from ..equations.measurement import Workspace
from ..equations.problem import SegmentProblem, SegmentSolution
from ..gauss_newton import descend, farthest_joint
from ..judgement.settled_solutions import SettledSolutions
from ..judgement.solution_doubts import MIN_FOLLOWED_SHARE
from ..judgement.solution_ranking import (
    likelihood_decides,
    settled_further,
)
from ..limb_evidence.limb_likelihood import MIN_GAIN, LimbOfPerformer, SupportOfLimb, evaluated, support_of_limbs
from ..thinned_frames import ThinnedProblem
from .faded_limbs import faded_limbs
from .limb_pairs_elsewhere import with_pairs_found
from .limb_rounds import with_limb_regained
from .limb_search import is_elsewhere
from .limbs_elsewhere import (
    found_elsewhere,
    likelier,
    likelier_with_limb,
    to_be_beaten,
)
from .search_rounds import MAX_SEARCH_ROUNDS
from .weakly_shown_limbs import with_weakly_shown_limbs_found

BEND_RATIO = 3.0
"""Ratio of a limb's acceleration at a key pose to its root mean square between key poses, from which on the motion
counts as bent there."""
MIN_SUPPORT = 0.8
"""Share of the evidence of a limb's pixels on key poses from which on its sides alone do not refute it."""
MAX_FURTHER_SEARCHES = 3
"""Further searches for a limb of a doubtful performer that stays refuted."""
KEY_ERROR = 0.01
"""Possible error of a key pose, metres: it changes the velocity by twice as much per frame."""


def with_limbs_regained(problem: SegmentProblem, solution: SegmentSolution, workspace: Workspace) -> SegmentSolution:
    """Search again for limbs that are bent at the ends of a refined solution, or refuted; where performers hide one
    another, also for those that have faded.

    Parameters
    ----------
    problem : SegmentProblem
    solution : SegmentSolution
    workspace : Workspace
    """
    seconds = Seconds(solution.seconds)
    with seconds.measure("initial solution"):
        lost = [(i, chain) for i in problem.sought for chain in bent_limbs(problem, i, solution.motions[i])]
        hidden = solution.unhidden.min() <= MIN_FOLLOWED_SHARE
        undoubted = not problem.among_others and problem.shows_depth and not problem.doubted
        measured = _support_on_some_frames(problem, solution.motions)
        support = evaluated(measured) if hidden or undoubted else None
        lost += [place for place in refuted_limbs(problem, solution.motions, support or measured) if place not in lost]
        if hidden:
            lost += [place for place in faded_limbs(problem, solution.motions, support) if place not in lost]
        known, before = SettledSolutions(), solution.motions
        for k, place in enumerate(lost):
            part = workspace.part(k / len(lost), (k + 1) / len(lost))
            solution = with_limb_regained(problem, solution, place, part, known)
        if undoubted:
            support = support if solution.motions is before else None
            solution = with_weakly_shown_limbs_found(problem, solution, known, workspace.silent(), support)
        if problem.doubted and not problem.among_others and likelihood_decides(problem):
            solution = _likelier_anywhere(problem, solution, known, workspace.silent())
    return replace(solution, seconds=dict(seconds))


def _support_on_some_frames(problem: SegmentProblem, motions: Sequence[Motion]) -> Iterator[SupportOfLimb]:
    """Generate the `support_of_limbs`; of a single performer, where frames follow each other closely, measured on some
    of them and interpolated.
    """
    thinned = None if problem.among_others else ThinnedProblem.of(problem, motions)
    if thinned is None:
        yield from support_of_limbs(problem, motions)
        return
    for i, chain, sides, shown in support_of_limbs(thinned.problem, thinned.of_motions(motions)):
        yield i, chain, thinned.between(sides), partial(_between, thinned, shown)


def _between(thinned: ThinnedProblem, shown: Callable[[], Array]) -> Array:
    return thinned.between(shown())


def _likelier_anywhere(
    problem: SegmentProblem, solution: SegmentSolution, known: SettledSolutions, workspace: Workspace
) -> SegmentSolution:
    """Look for the likelier solution of a single performer: from beside the minimum, with each limb elsewhere, and in
    several views with both limbs of a pair.
    """
    solution = _stirred(problem, solution, known, workspace)
    for chain in limbs(problem.bodies[0]):
        solution = _with_limb_looked_for(problem, solution, (0, chain), known, workspace=workspace)
    for i, chain in refuted_limbs(problem, solution.motions):
        present = solution.motions[i]
        for more in range(1, 1 + MAX_FURTHER_SEARCHES):  # one search of several finds a limb that moves fast
            solution = _with_limb_looked_for(problem, solution, (i, chain), known, workspace=workspace, more=more)
            if is_elsewhere(problem.bodies[i], chain, present, solution.motions[i]):
                break
    if problem.shows_depth:
        solution = with_pairs_found(problem, solution, limb_pairs(problem.bodies[0]), known, workspace)
    return solution


def _stirred(
    problem: SegmentProblem, solution: SegmentSolution, known: SettledSolutions, workspace: Workspace
) -> SegmentSolution:
    """Lead a single performer out of its minimum by coarse steps, and return the likelier solution.

    A trunk and a leg may be wrong together, so that neither is found while the other stays.
    """
    first = known.after(problem, solution, workspace)
    found = descend(problem, first.solution.motions, workspace, (*COARSE_RESTART, *SETTLED), first.noise)
    if farthest_joint(problem, first.solution.motions, found.motions) < UNCONVERGED_MOVE:
        return solution
    found = settled_further(problem, first.noise, found, workspace, rival=to_be_beaten(problem, first))
    return likelier(problem, solution, first, found, workspace)


def _with_limb_looked_for(
    problem: SegmentProblem,
    solution: SegmentSolution,
    place: LimbOfPerformer,
    known: SettledSolutions,
    *,
    workspace: Workspace,
    more: int = 0,
) -> SegmentSolution:
    """Search for a limb of a single performer, however well it is seen, for as long as it is found elsewhere.

    `more` numbers repetitions, which draw other poses.
    """
    i, chain = place
    for turn in range(MAX_SEARCH_ROUNDS):
        before, first = solution.motions[i], known.after(problem, solution, workspace)
        found = found_elsewhere(problem, first.solution.motions, place, (1 + more) * MAX_SEARCH_ROUNDS + turn)
        if found is None:
            break
        solution = likelier_with_limb(problem, solution, first, place, found, workspace=workspace)
        if not is_elsewhere(problem.bodies[i], chain, before, solution.motions[i]):
            break
    return solution


def refuted_limbs(
    problem: SegmentProblem, motions: Sequence[Motion], support: Iterable[SupportOfLimb] | None = None
) -> list[LimbOfPerformer]:
    """Find the limbs without which the images would be likelier on some run of frames.

    This holds if the log likelihood ratio of the brightness across a limb's sides is below -`MIN_GAIN` in sum, while
    the limb's pixels show it less than on the key poses (`MIN_SUPPORT`). Sides alone do not refute it: how they look
    was learned on the few key poses, so that over a long time between them small errors add up to any sum. It also
    holds if both this ratio and that of sides and pixels together are negative over `LONG_GAP` frames, longer
    than prediction bridges. A limb that is hidden in all views is not refuted.

    Parameters
    ----------
    problem : SegmentProblem
    motions : sequence of Motion
        F poses per performer.
    support : iterable of SupportOfLimb, optional
        Of these motions, if it is known.
    """
    found = []
    for i, chain, sides, shown in support_of_limbs(problem, motions) if support is None else support:
        shown, (first, end) = cache(shown), _worst_run(sides)
        refuted = sides[first:end].sum() < -MIN_GAIN and (
            (pixels := shown() - sides)[first:end].mean() < MIN_SUPPORT * pixels[problem.whole_keys(i)].mean()
        )
        if refuted or (_against_for_long(sides) and _against_for_long(shown())):
            found.append((i, chain))
    return found


def _worst_run(ratios: Array) -> tuple[int, int]:
    """Return the frames, first and after the last, between which log likelihood ratios (F,) have the least sum."""
    upto = np.cumsum([0.0, *ratios])
    end = int(np.argmax(np.maximum.accumulate(upto) - upto))
    return int(np.argmax(upto[: end + 1])), end


def _against_for_long(shown: Array) -> bool:
    """Whether log likelihood ratios (F,) are negative in sum over some `LONG_GAP` frames."""
    upto = np.cumsum([0.0, *shown])
    return bool((upto[LONG_GAP:] < upto[:-LONG_GAP]).any())


def bent_limbs(problem: SegmentProblem, performer: int, motion: Motion) -> list[list[int]]:
    """Find the limbs of a performer whose velocity changes abruptly where the segment meets the motion beside it.

    Parameters
    ----------
    problem : SegmentProblem
    performer : int
    motion : Motion
        F poses.

    Returns
    -------
    list of list of int
        Chains of parts.
    """
    keys, chains = problem.whole_keys(performer), limbs(problem.bodies[performer])
    at_ends = {0, problem.length - 1} & set(keys.tolist())
    if not at_ends or problem.around(performer) == (None, None):
        return []
    return [chain for chain in chains if bend_of(problem, performer, motion, chain) > 1.0]


def bend_of(problem: SegmentProblem, performer: int, motion: Motion, chain: Sequence[int]) -> float:
    """Ratio of the change of a limb's velocity at the segment's ends to the least that counts as bent."""
    F, keys = len(motion), problem.whole_keys(performer)
    before, after = problem.around(performer)
    known = stacked([m for m in (before, motion, after) if m is not None])
    start = 0 if before is None else 1
    change = _joint_changes(problem, performer, known, chain)
    frames = np.arange(1, len(known) - 1) - start
    between = change[(np.abs(frames[:, None] - keys[None]) > 1).all(axis=1)]
    usual = np.sqrt(np.sum(between**2, axis=0) / max(len(between), 1))
    least = np.maximum(BEND_RATIO * usual, 2 * KEY_ERROR)
    ends = np.isin(frames, [end for end in (0, F - 1) if end in keys])
    return float((change[ends] / least).max(initial=0.0))


def _joint_changes(problem: SegmentProblem, performer: int, motion: Motion, chain: Sequence[int]) -> Array:
    """Changes of velocity of a limb's joints relative to its first joint, metres per frame, (F - 2, n)."""
    _, T = part_poses(problem.bodies[performer], motion)
    joints = T[:, chain[1:]] - T[:, [chain[0]]]
    return np.asarray(np.linalg.norm(second_differences(joints, problem.known_steps(performer)), axis=-1))
