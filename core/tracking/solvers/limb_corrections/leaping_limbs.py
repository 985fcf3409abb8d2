"""Limbs that leap away and back within a moment: whether a straight path across is better.

While a limb is hidden, or two legs pass each other, the solution may have it elsewhere on a few frames, in a local
minimum. These are too few frames for the search around the whole motion to correct them, but the leaps stand out from
how the limb moves otherwise.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ....body import part_poses
from ....body.limbs import limbs
from ....body.motion import Motion, with_motion
from ....runtime.timing import Seconds
from ..assessment.solution_ranking import noise_at
from ..descent_stages import SETTLED
from ..equations.measurement import Workspace
from ..equations.problem import SegmentProblem, SegmentSolution
from ..gauss_newton import continued, descend
from .bridges import BRIDGING, LEAP_RATIO, Leap, bridged_motion
from .local_trials import likelier_after_change
from .long_leaps import long_leaps, with_long_leaps_bridged

MIN_LEAP_ACCELERATION = 0.05
"""Smallest acceleration of a leap, metres per frame squared; a heel is stopped as abruptly when it meets the floor."""
MAX_ABSENCE = 0.3
"""Longest time that a limb may be away, seconds: over a longer one, a straight path is far from the true one."""
MAX_LEAP_INTERVAL = 0.1
"""Two leaps within this time are one away and one back, seconds."""


def with_leaps_bridged(
    problem: SegmentProblem, solution: SegmentSolution, workspace: Workspace, *, long_only: bool = False
) -> SegmentSolution:
    """Lead limbs that leap straight across, or search for them there (`long_leaps`), where that makes the images
    likelier.

    Performers are treated in turn, with the motions of the others given.

    Parameters
    ----------
    problem : SegmentProblem
    solution : SegmentSolution
    workspace : Workspace
    long_only : bool
        Whether limbs are only searched for, not led straight across.
    """
    best, seconds = solution, Seconds(solution.seconds)
    for k, i in enumerate(problem.sought):
        part = workspace.part(k / len(problem.sought), (k + 1) / len(problem.sought))
        found = [] if long_only else leaps(problem, i, best.motions[i])
        if not (found or long_leaps(problem, i, best.motions[i])):
            continue
        alone = problem.alone(i)
        with seconds.measure("initial solution"):
            bridged = _bridged(alone, i, replace(best, only=alone.only), found, part)
        if bridged is not None:
            best = continued(best, replace(bridged, only=problem.only))
    if best is solution:
        return solution if seconds == solution.seconds else replace(solution, seconds=seconds)
    if len(problem.sought) > 1:
        ended = descend(problem, best.motions, workspace.silent(), SETTLED)
        seconds.add(ended.seconds)
        best = continued(best, ended)
    return replace(best, seconds=seconds)


def _bridged(
    problem: SegmentProblem, performer: int, before: SegmentSolution, found: Sequence[Leap], workspace: Workspace
) -> SegmentSolution | None:
    """Bridge the leaps of one performer where that is better; None if it is nowhere."""
    noise = noise_at(problem, before, workspace)
    settled = best = descend(problem, before.motions, workspace.silent(), SETTLED, noise)
    for k, leap in enumerate(found):
        motion = bridged_motion(best.motions[performer], leap, problem.fixed[performer])
        motions = with_motion(best.motions, performer, motion)
        part = workspace.part(k / len(found), (k + 1) / len(found))
        best = likelier_after_change(problem, noise, best, motions, part, stages=BRIDGING)
    best = with_long_leaps_bridged(problem, performer, best, noise, workspace.silent())
    return None if best is settled else best


def leaps(problem: SegmentProblem, performer: int, motion: Motion) -> list[Leap]:
    """Find the leaps of a performer's limbs in a motion of F poses, between frames on which key poses fix them."""
    body, F = problem.bodies[performer], len(motion)
    if F < 4:
        return []
    _, T = part_poses(body, motion)
    held = problem.fixed_axes(performer).all(axis=2)
    away: dict[int, list[int]] = {}
    for chain in limbs(body):
        joints = T[:, chain[1:]] - T[:, [chain[0]]]
        change = np.linalg.norm(np.diff(joints, 2, axis=0), axis=-1).max(axis=1)
        leaping = np.concatenate(
            [[False], change > max(LEAP_RATIO * float(np.median(change)), MIN_LEAP_ACCELERATION), [False]]
        )
        for f in np.flatnonzero(leaping & ~held[:, chain].any(axis=1)).tolist():
            away.setdefault(f, []).extend(chain)
    found: list[Leap] = []
    for f in sorted(away):
        near = found and f - found[-1].last <= max(1, round(MAX_LEAP_INTERVAL * problem.fps))
        if near and not held[found[-1].last : f].any():
            found[-1] = Leap(found[-1].first, f, tuple(sorted({*found[-1].parts, *away[f]})))
        else:
            found.append(Leap(f, f, tuple(sorted(away[f]))))
    return [leap for leap in found if 1 <= leap.last - leap.first <= max(2, round(MAX_ABSENCE * problem.fps))]
