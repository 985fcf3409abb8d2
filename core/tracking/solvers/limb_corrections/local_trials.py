"""Parts of a segment, in which a change of a few of its frames is tried while the motion beside them stays."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ....body.motion import Motion
from ..equations.problem import SegmentProblem
from ..equations.segment_equations import SegmentNoise
from ..starts.sequential_start import excerpt

ADAPTATION_TIME = 0.3
"""Time before and after changed frames within which the motion may adapt to the change, seconds."""
MAX_SHARE = 0.75
"""Share of a segment's frames up to which it saves time to try a change on these frames alone."""
HELD_FRAMES = 2
"""Frames at an end that hold the position and the velocity of the motion beside it."""


@dataclass(frozen=True, eq=False)
class LocalTrial:
    """Frames `first` to `stop` - 1 of a segment as a problem of their own.

    Attributes
    ----------
    first, stop : int
    problem : SegmentProblem
        Of these frames; those at an end that is not the segment's are fixed.
    noise : SegmentNoise
        That of the whole segment, on these frames.
    """

    first: int
    stop: int
    problem: SegmentProblem
    noise: SegmentNoise

    @classmethod
    def around(
        cls, problem: SegmentProblem, noise: SegmentNoise, before: Sequence[Motion], after: Sequence[Motion]
    ) -> LocalTrial | None:
        """Return the frames on which two motions differ and those beside them; None if these are most of the segment.

        Parameters
        ----------
        problem : SegmentProblem
        noise : SegmentNoise
        before, after : sequence of Motion
            F poses per performer.
        """
        differ = np.flatnonzero(
            np.any([a.difference(b).any(axis=1) for a, b in zip(before, after, strict=True)], axis=0)
        )
        F, beside = problem.length, HELD_FRAMES + round(ADAPTATION_TIME * problem.fps)
        if not len(differ):
            return None
        first, stop = max(int(differ[0]) - beside, 0), min(int(differ[-1]) + 1 + beside, F)
        if stop - first > MAX_SHARE * F:
            return None
        own = excerpt(problem, first, stop)
        held = np.zeros(stop - first, dtype=bool)
        held[:HELD_FRAMES] = first > 0
        held[stop - first - HELD_FRAMES :] |= stop < F
        own = replace(own, fixed=tuple(fixed | held[:, None] for fixed in own.fixed))
        pairs = slice(first, stop - 1)
        local = SegmentNoise(noise.sigma[:, pairs], noise.weight[:, pairs], noise.share)
        return cls(first, stop, own, local)

    def of(self, motions: Sequence[Motion]) -> tuple[Motion, ...]:
        """Return motions of the whole segment on these frames."""
        return tuple(motion[self.first : self.stop] for motion in motions)

    def within(self, motions: Sequence[Motion], own: Sequence[Motion]) -> tuple[Motion, ...]:
        """Return motions of the whole segment with others on these frames."""
        return tuple(motion.replaced(self.first, new) for motion, new in zip(motions, own, strict=True))
