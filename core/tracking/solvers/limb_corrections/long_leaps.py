"""Limbs that leap and stay away, up to the next leap or the next key pose: they are searched for around a path without
the leap.

No limb moves from one place to another within a frame, and slowly before and after that. One that does is lost on one
side of the leap, or on both: on the side of a key pose that is right beside it, it is found. A descent does not lead
out of there, nor does a search around the present motion, which what it finds departs from slowly: the leap remains.
So the limb is first led evenly across the frames on which it may be lost, far from the pictures, and searched for
around that.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ....body import part_poses
from ....body.limbs import limbs
from ....body.motion import Motion, stacked, with_motion
from ....body.smoothness import second_differences
from ....numerics.arrays import Array, Bools
from ..descent_stages import OUTLINE_REACH, SETTLED
from ..equations.measurement import Workspace
from ..equations.problem import SegmentProblem, SegmentSolution
from ..equations.segment_equations import SegmentNoise
from .bridges import BRIDGING, LEAP_RATIO, Leap, bridged_motion
from .limb_search import freed_limb
from .limbs_elsewhere import is_elsewhere
from .local_trials import is_long, likelier_after_change, longest_piece, stretch_around, stretch_of

STEP_TIME = 1 / 30
"""Time within which a limb leaps, seconds: where frames follow each other more closely, smoothness spreads a leap over
several of them."""
MAX_TRIALS = 6
"""Most intervals of a performer on which the limb is searched for."""
MIN_FRAMES = 2
"""Frames in a row on which the search must find the limb elsewhere: the poses that it draws scatter."""


@dataclass(frozen=True)
class AbruptStep:
    """A step of a limb that neither the one before nor the one after resembles.

    Attributes
    ----------
    before, after : int
        Frames of the segment between which it is, from -1 to F: what is known beside the segment counts.
    size : float
        How far it goes beyond both, metres.
    """

    before: int
    after: int
    size: float


def with_long_leaps_bridged(
    problem: SegmentProblem,
    performer: int,
    solution: SegmentSolution,
    noise: SegmentNoise,
    workspace: Workspace,
) -> SegmentSolution:
    """Search for limbs of one performer beside abrupt steps, and keep what makes the images likelier.

    The largest step comes first. After each find, what still leaps is looked for again.

    Parameters
    ----------
    problem : SegmentProblem
        Of one performer, see `SegmentProblem.alone`.
    performer : int
    solution : SegmentSolution
        Measured under the noise.
    noise : SegmentNoise
    workspace : Workspace
    """
    tried: set[Leap] = set()
    best, leaps = solution, long_leaps(problem, performer, solution.motions[performer])
    while len(tried) < MAX_TRIALS:
        leap = next((one for one in leaps if one not in tried), None)
        if leap is None:
            break
        tried.add(leap)
        motion = _searched_across(problem, performer, best.motions, leap)
        if not is_elsewhere(problem.bodies[performer], leap.parts, best.motions[performer], motion, MIN_FRAMES):
            continue  # found again from a path without the leap: it moves that fast
        # Where others hide much, coarse steps lead away again from what a search has found.
        stages = SETTLED if problem.among_others else BRIDGING
        motions = with_motion(best.motions, performer, motion)
        likelier = likelier_after_change(problem, noise, best, motions, workspace.silent(), stages=stages)
        if likelier is not best:
            best, leaps = likelier, long_leaps(problem, performer, likelier.motions[performer])
    return best


def _searched_across(problem: SegmentProblem, performer: int, motions: Sequence[Motion], leap: Leap) -> Motion:
    """Search for a limb around an even path across some frames; on all others it stays. Of a long segment, only these
    frames and those beside them are looked at.
    """
    if not is_long(problem):
        return _searched_on(problem, performer, motions, leap)
    stretch = stretch_around(problem, leap.first, leap.last)
    first, stop = stretch.first, stretch.last + 1
    here = replace(leap, first=leap.first - first, last=leap.last - first)
    found = _searched_on(stretch_of(problem, stretch), performer, [motion[first:stop] for motion in motions], here)
    return motions[performer].replaced(first, found)


def _searched_on(problem: SegmentProblem, performer: int, motions: Sequence[Motion], leap: Leap) -> Motion:
    fixed = problem.fixed[performer].copy()
    outside = np.ones(problem.length, bool)
    outside[leap.first : leap.last + 1] = False
    for part in leap.parts:
        fixed[outside, 3 + 3 * part : 6 + 3 * part] = True
    bridged = bridged_motion(motions[performer], leap, problem.fixed[performer])
    inside = replace(problem, fixed=(*problem.fixed[:performer], fixed, *problem.fixed[performer + 1 :]))
    return freed_limb(inside, with_motion(motions, performer, bridged), (performer, list(leap.parts)), 0)


def long_leaps(problem: SegmentProblem, performer: int, motion: Motion) -> list[Leap]:
    """Return the intervals beside abrupt steps of a performer's limbs, those of the largest step first.

    Each runs from a step, in either direction, to the next one, to a frame on which a key pose holds part of the limb,
    or to the end of the segment; in a long segment, no farther than the shortest long one. Among several performers a
    limb that leaps on within `MIN_FRAMES` is away until the leap after that.

    Parameters
    ----------
    problem : SegmentProblem
    performer : int
    motion : Motion
        F poses.
    """
    F, found = len(motion), list[tuple[float, Leap]]()
    least = MIN_FRAMES if problem.among_others else 1
    most = longest_piece(problem) if is_long(problem) else F
    held = problem.fixed_axes(performer).all(axis=2)
    for chain in limbs(problem.bodies[performer]):
        steps = abrupt_steps(problem, performer, motion, chain)
        for step in steps:
            for first, last in _beside(step, steps, held[:, chain].any(axis=1), (least, most)):
                if last - first + 1 < F:
                    found.append((step.size, Leap(first, last, tuple(chain))))
    ordered = [leap for _, leap in sorted(found, key=lambda one: -one[0])]
    return list(dict.fromkeys(ordered))


def _beside(
    step: AbruptStep, steps: Sequence[AbruptStep], held: Bools, lengths: tuple[int, int]
) -> Iterator[tuple[int, int]]:
    """Generate the first and last frames of the intervals after a step and before it. Of the two lengths, steps that
    would end them within fewer frames than the first do not, and they have no more than the second.
    """
    F, (least, most) = len(held), lengths
    known = np.flatnonzero(held).tolist()
    first = step.after
    ends = [s.after for s in steps if s.before >= first and s.after - first >= least]
    end = min([k for k in known if k >= first] + ends, default=F)
    if first < end:
        yield first, min(end, first + most) - 1
    last = step.before
    begins = [s.before for s in steps if s.after <= last and last - s.before >= least]
    begin = max([k for k in known if k <= last] + begins, default=-1)
    if begin < last:
        yield max(begin + 1, last + 1 - most), last


def abrupt_steps(problem: SegmentProblem, performer: int, motion: Motion, chain: Sequence[int]) -> list[AbruptStep]:
    """Find the abrupt steps of a limb in a motion of F poses, in time.

    The limb's joints, relative to its first, are looked at `STEP_TIME` apart. A step is abrupt if what it goes beyond
    the one before and beyond the one after, whichever is less, exceeds `LEAP_RATIO` times the median of such changes,
    and what a descent reaches. Where nothing is known on one side, the other decides. Of steps that share frames the
    largest counts.
    """
    before, after = problem.around(performer)
    known = stacked([m for m in (before, motion, after) if m is not None])
    _, T = part_poses(problem.bodies[performer], known)
    joints, start = T[:, chain[1:]] - T[:, [chain[0]]], 0 if before is None else 1
    fixed = problem.fixed_axes(performer)[:, chain].all(axis=(1, 2))
    held = np.pad(fixed, (start, len(known) - start - len(motion)), constant_values=True)
    every = max(1, round(STEP_TIME * problem.fps))
    found: list[AbruptStep] = []
    for offset in range(every):
        frames = np.arange(offset, len(known), every)
        if len(frames) < 4:
            continue
        steps = problem.known_steps(performer) if every == 1 else None
        sizes, usual = _beyond_neighbours(joints[frames], steps)
        least = max(LEAP_RATIO * usual, OUTLINE_REACH)
        for k in np.flatnonzero((sizes > least) & ~(held[frames[:-1]] & held[frames[1:]])).tolist():
            found.append(AbruptStep(int(frames[k]) - start, int(frames[k + 1]) - start, float(sizes[k])))
    largest: list[AbruptStep] = []
    for step in sorted(found, key=lambda one: -one.size):
        if all(step.after <= other.before or step.before >= other.after for other in largest):
            largest.append(step)
    return sorted(largest, key=lambda one: one.before)


def leaps_farther(
    problem: SegmentProblem, performer: int, before: Motion, after: Motion, chains: Sequence[Sequence[int]]
) -> bool:
    """Whether any of some limbs leaps farther in one motion than in another, F poses each, by the sum of its abrupt
    steps.
    """

    def leapt(motion: Motion, chain: Sequence[int]) -> float:
        return sum(step.size for step in abrupt_steps(problem, performer, motion, chain))

    return any(leapt(after, chain) > leapt(before, chain) for chain in chains)


def _beyond_neighbours(joints: Array, steps: Array | None) -> tuple[Array, float]:
    """Return how far each step of joints (F, n, 3) goes beyond both neighbours, (F - 1,), and the median change from
    step to step.
    """
    change = second_differences(joints, steps)
    size = np.linalg.norm(change, axis=-1)
    both = np.where(np.sum(change[:-1] * change[1:], axis=-1) < 0, np.minimum(size[:-1], size[1:]), 0.0)
    beyond = np.concatenate([size[:1], both, size[-1:]])
    return beyond.max(axis=1), float(np.median(size.max(axis=1)))
