"""Signs that a limb is lost, even in front of the body, where it covers foreground and so seems right.

- *Bent:* its velocity changes abruptly at a key pose. The performer knows nothing of the frames that the animator
  chose, so a fist that moves steadily up to a key pose and turns away exactly there has been lost on one side of it.
- *Refuted:* brightness does not change across its sides as on key poses, or its pixels look as if it were not there.
- *Faded:* the images show it less clearly for a moment than for most of the time. Where people pass each other, a limb
  may be led astray by somebody else. It then lies on another performer, or behind its own, so that neither background
  nor uncovered foreground shows the error. But while it is astray, the images speak less for it.
- *Weakly shown:* the images show it less clearly than on the key poses. So they do a limb that is lost in front of the
  body, or along the line of sight of one of two cameras, where it covers foreground and leaves hardly any uncovered.

All but the first follow from what the images say for limbs (`SupportOfLimb`). None proves that a limb is lost: limbs
are hidden for a while, and do turn away at key poses. Of limbs that the images do not show on the key poses either
(`unshown_limbs`), they prove nothing. A limb is too small a part of the performer for its cover to raise a doubt
(`solution_doubts`).
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import cache

import numpy as np

from ....body import part_poses
from ....body.limbs import limbs
from ....body.motion import Motion, stacked
from ....body.smoothness import second_differences
from ....evidence.occlusion import LONG_GAP
from ....numerics.arrays import Array, Bools, Ints
from ....numerics.frame_ranges import runs
from ..equations.problem import SegmentProblem
from ..limb_evidence.limb_likelihood import MIN_GAIN
from ..limb_evidence.limb_model import LimbOfPerformer
from ..limb_evidence.limb_support import SupportOfLimb, least_supported
from .solution_doubts import MIN_DURATION

BEND_RATIO = 3.0
"""Ratio of a limb's acceleration at a key pose to its root mean square between key poses, from which on the motion
counts as bent there."""
KEY_ERROR = 0.01
"""Possible error of a key pose, metres: it changes the velocity by twice as much per frame."""
MIN_SUPPORT = 0.8
"""Share of the evidence of a limb's pixels on key poses from which on its sides alone do not refute it."""
FADED_RATIO = 0.5
"""Ratio of the support of a limb on a frame to its median over the segment, below which it has faded."""
WEAK_RATIO = 0.7
"""Ratio of the support of a limb, in the mean over `MIN_DURATION`, to its support on the key poses, below which it is
weakly shown."""


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


def refuted_limbs(problem: SegmentProblem, support: Iterable[SupportOfLimb]) -> list[LimbOfPerformer]:
    """Find the limbs without which the images would be likelier on some run of frames.

    This holds if the log likelihood ratio of the brightness across a limb's sides is below -`MIN_GAIN` in sum, while
    the limb's pixels show it less than on the key poses (`MIN_SUPPORT`). Sides alone do not refute it: how they look
    was learned on the few key poses, so that over a long time between them small errors add up to any sum. It also
    holds if both this ratio and that of sides and pixels together are negative over `LONG_GAP` frames, longer
    than prediction bridges. A limb that is hidden in all views is not refuted.
    """
    found = []
    for i, chain, sides, shown in support:
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


def faded_limbs(problem: SegmentProblem, support: Iterable[SupportOfLimb]) -> list[LimbOfPerformer]:
    """Find the limbs whose support, the log likelihood ratio of the images with the limb where it is against without
    it, is low for a moment: the one that falls lowest first.
    """
    long = _least_duration(problem)
    return least_supported(support, lambda _, shown: _lowest_support(shown, long), FADED_RATIO)


def _lowest_support(support: Array, long: int) -> float:
    """Lowest mean of a limb's support (F,), relative to its median, over an interval of `long` frames or more on all of
    which it has faded; 1 if there is none.
    """
    usual = max(float(np.median(support)), 1e-9)
    faded = runs(support < FADED_RATIO * usual)
    means = [support[first : last + 1].mean() / usual for first, last in faded if last + 1 - first >= long]
    return float(min(means, default=1.0))


def weakly_shown_limbs(problem: SegmentProblem, support: Iterable[SupportOfLimb]) -> list[LimbOfPerformer]:
    """Find the limbs that the images show less clearly for a moment than on the key poses (`WEAK_RATIO`), the weakest
    first.
    """
    long = _least_duration(problem)
    return least_supported(support, lambda i, shown: _weakest_support(shown, problem.whole_keys(i), long), WEAK_RATIO)


def _weakest_support(support: Array, keys: Ints, long: int) -> float:
    """Least mean of a limb's support (F,) over `long` frames, relative to that on the key poses, interpolated between
    them; 1 without key poses, or with fewer frames.
    """
    return float(_relative_support(support, keys, long).min(initial=1.0))


def unshown_limbs(problem: SegmentProblem, support: Iterable[SupportOfLimb]) -> list[LimbOfPerformer]:
    """Find the limbs that the images do not show where they are known to be: on the key poses, they say less for them
    in the mean than what would have a limb moved (`MIN_GAIN`) in `LONG_GAP` frames.

    Their colours look like what is behind them, or are not known, as others who are not posed were near. Such images
    do not tell where the limb is between the key poses: they are likelier where it hides in front of the body.
    """

    def on_keys(i: int, shown: Array) -> float:
        keys = problem.whole_keys(i)
        return float(shown[keys].mean()) if len(keys) else np.inf

    return least_supported(support, on_keys, MIN_GAIN / LONG_GAP)


def frames_weakly_shown(problem: SegmentProblem, performer: int, support: Array) -> Bools:
    """Return on which frames the images show a limb of a performer weakly (`weakly_shown_limbs`), by its support (F,),
    shape (F,).
    """
    long = _least_duration(problem)
    weak = _relative_support(support, problem.whole_keys(performer), long) < WEAK_RATIO
    return np.convolve(weak, np.ones(long)) > 0 if len(weak) else np.zeros(len(support), dtype=bool)


def _relative_support(support: Array, keys: Ints, long: int) -> Array:
    """Means of a limb's support (F,) over every `long` frames in a row, relative to that on the key poses; none without
    key poses, or with fewer frames.
    """
    if not len(keys) or len(support) < long:
        return np.zeros(0)
    usual = np.maximum(np.interp(np.arange(len(support)), keys, support[keys]), 1e-9)
    return np.convolve(support / usual, np.full(long, 1 / long), "valid")


def _least_duration(problem: SegmentProblem) -> int:
    """Number of frames that `MIN_DURATION` takes."""
    return max(2, int(np.ceil(MIN_DURATION * problem.fps)))
