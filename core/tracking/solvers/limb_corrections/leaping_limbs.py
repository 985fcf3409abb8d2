"""Limbs that leap away and back within a moment: whether a straight path across is better.

While a limb is hidden, or two legs pass each other, the solution may have it elsewhere on a few frames, in a local
minimum. These are too few frames for the search around the whole motion to correct them, but the leaps stand out from
how the limb moves otherwise.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ....body import part_poses
from ....body.limbs import limbs
from ....body.motion import Motion, with_motion
from ....numerics import rotations
from ....numerics.arrays import Bools
from ....runtime.timing import Seconds
from ..descent_stages import SETTLED, SETTLING
from ..equations.measurement import Workspace
from ..equations.problem import SegmentProblem, SegmentSolution
from ..gauss_newton import continued, descend
from ..judgement.solution_ranking import likeliest, noise_at

LEAP_RATIO = 6.0
"""Smallest ratio of the acceleration at a leap to the limb's median acceleration."""
MIN_LEAP_ACCELERATION = 0.05
"""Smallest acceleration of a leap, metres per frame squared; a heel is stopped as abruptly when it meets the floor."""
MAX_ABSENCE = 0.3
"""Longest time that a limb may be away, seconds: over a longer one, a straight path is far from the true one."""
MAX_LEAP_INTERVAL = 0.1
"""Two leaps within this time are one away and one back, seconds."""

BRIDGING = (*SETTLING, *SETTLED, *SETTLED)
"""From a straight path to the solution. The rest of the body must converge again as far as before, or its residuals
outweigh those of the limb."""


@dataclass(frozen=True)
class Leap:
    """An interval in which limbs are away.

    Attributes
    ----------
    first, last : int
        First and last of its frames.
    parts : tuple of int
        Indices of the parts of all limbs that leap there.
    """

    first: int
    last: int
    parts: tuple[int, ...]


def with_leaps_bridged(problem: SegmentProblem, solution: SegmentSolution, workspace: Workspace) -> SegmentSolution:
    """Lead limbs that leap straight across where that makes the images likelier.

    Performers are treated in turn, with the motions of the others given.

    Parameters
    ----------
    problem : SegmentProblem
    solution : SegmentSolution
    workspace : Workspace
    """
    best, seconds = solution, Seconds(solution.seconds)
    for k, i in enumerate(problem.sought):
        part = workspace.part(k / len(problem.sought), (k + 1) / len(problem.sought))
        found = leaps(problem, i, best.motions[i])
        if not found:
            continue
        alone = problem.alone(i)
        with seconds.measure("initial solution"):
            bridged = _bridged(alone, i, replace(best, only=alone.only), found, part)
        if bridged is not None:
            best = continued(best, replace(bridged, only=problem.only))
    if best is solution:
        return replace(solution, seconds=seconds)
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
        best = likeliest(problem, noise, best, descend(problem, motions, part, BRIDGING, noise))
    return None if best is settled else best


def leaps(problem: SegmentProblem, performer: int, motion: Motion) -> list[Leap]:
    """Find the leaps of a performer's limbs in a motion of F poses, between frames on which key poses fix them."""
    body, F = problem.bodies[performer], len(motion)
    if F < 4:
        return []
    _, T = part_poses(body, motion)
    held = problem.fixed[performer][:, 3:].reshape(F, -1, 3).all(axis=2)
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


def bridged_motion(motion: Motion, leap: Leap, fixed: Bools) -> Motion:
    """Turn the limbs evenly from the frame before a leap to the one after it, except for what is fixed (F, D)."""
    parts, Q = list(leap.parts), motion.rotations.copy()
    before, after = Q[leap.first - 1, parts], Q[leap.last + 1, parts]
    turn = rotations.log(np.swapaxes(before, -1, -2) @ after)
    share = np.linspace(0, 1, leap.last - leap.first + 3)[1:-1, None, None]
    frames = np.arange(leap.first, leap.last + 1)
    kept = fixed[frames, 3:].reshape(len(frames), -1, 3)[:, parts].any(axis=2)[..., None, None]
    Q[frames[:, None], parts] = np.where(kept, Q[frames[:, None], parts], before @ rotations.exp(share * turn))
    return Motion(motion.translations, Q)
