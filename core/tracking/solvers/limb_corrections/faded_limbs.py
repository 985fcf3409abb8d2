"""Limbs of one of several performers that the images show less clearly for a moment, and that may therefore be lost.

Where people pass each other, a limb may be led astray by somebody else. It then lies on another performer, or behind
its own, so that neither background nor uncovered foreground shows the error, and a limb is too small a part of a
performer for its cover to raise a doubt. But while it is astray, the images speak less for it than on the rest of its
way.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from ....body.motion import Motion
from ....numerics.arrays import Array
from ....numerics.frame_ranges import runs
from ..equations.problem import SegmentProblem
from ..limb_evidence.limb_likelihood import LimbOfPerformer, SupportOfLimb, least_supported, support_of_limbs

FADED_RATIO = 0.5
"""Ratio of the support of a limb on a frame to its median over the segment, below which it has faded."""
MIN_DURATION = 0.1
"""Shorter intervals do not count, seconds."""


def faded_limbs(
    problem: SegmentProblem, motions: Sequence[Motion], support: Iterable[SupportOfLimb] | None = None
) -> list[LimbOfPerformer]:
    """Find the limbs whose support, the log likelihood ratio of the images with the limb where it is against without
    it, is low for a moment: the one that falls lowest first.

    Parameters
    ----------
    problem : SegmentProblem
    motions : sequence of Motion
        F poses per performer.
    support : iterable of SupportOfLimb, optional
        Of these motions, if it is known.
    """
    long = max(2, int(np.ceil(MIN_DURATION * problem.fps)))
    support = support_of_limbs(problem, motions) if support is None else support
    return least_supported(support, lambda _, shown: _lowest_support(shown, long), FADED_RATIO)


def _lowest_support(support: Array, long: int) -> float:
    """Lowest mean of a limb's support (F,), relative to its median, over an interval of `long` frames or more on all of
    which it has faded; 1 if there is none.
    """
    usual = max(float(np.median(support)), 1e-9)
    faded = runs(support < FADED_RATIO * usual)
    means = [support[first : last + 1].mean() / usual for first, last in faded if last + 1 - first >= long]
    return float(min(means, default=1.0))
