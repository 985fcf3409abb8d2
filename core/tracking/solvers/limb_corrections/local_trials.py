"""Parts of a segment, in which a change of a few of its frames is tried while the motion beside them stays."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from ....body.motion import Motion
from ....numerics.arrays import Bools
from ....numerics.frame_ranges import adjacent_joined, runs
from ..assessment.solution_ranking import likeliest
from ..descent_stages import DescentStage
from ..equations.measurement import Workspace, solution_at
from ..equations.problem import SegmentProblem, SegmentSolution
from ..equations.segment_equations import SegmentNoise
from ..gauss_newton import descend
from ..starts.sequential_start import excerpt

ADAPTATION_TIME = 0.3
"""Time before and after changed frames within which the motion may adapt to the change, seconds."""
MAX_SHARE = 0.75
"""Share of a segment's frames up to which it saves time to try a change on these frames alone."""
LONG_RATIO = 4
"""How many times as long as the frames beside a moment a long segment is at least: 2.4 s and more."""
HELD_FRAMES = 2
"""Frames at an end that hold the position and the velocity of the motion beside it."""


@dataclass(frozen=True)
class Stretch:
    """Frames `first` to `last` of a segment that are solved apart from the rest.

    Attributes
    ----------
    first, last : int
    held : tuple of bool
        Whether the motion beside the first and the last of them is held. Beside an end that is free it is in doubt
        itself.
    """

    first: int
    last: int
    held: tuple[bool, bool] = (True, True)


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
        F, beside = problem.length, _frames_beside(problem)
        if not len(differ):
            return None
        first, stop = max(int(differ[0]) - beside, 0), min(int(differ[-1]) + 1 + beside, F)
        if stop - first > MAX_SHARE * F:
            return None
        own = held_excerpt(problem, first, stop)
        pairs = slice(first, stop - 1)
        local = SegmentNoise(noise.sigma[:, pairs], noise.weight[:, pairs], noise.share)
        return cls(first, stop, own, local)

    def of(self, motions: Sequence[Motion]) -> tuple[Motion, ...]:
        """Return motions of the whole segment on these frames."""
        return tuple(motion[self.first : self.stop] for motion in motions)

    def within(self, motions: Sequence[Motion], own: Sequence[Motion]) -> tuple[Motion, ...]:
        """Return motions of the whole segment with others on these frames."""
        return tuple(motion.replaced(self.first, new) for motion, new in zip(motions, own, strict=True))


def likelier_after_change(
    problem: SegmentProblem,
    noise: SegmentNoise,
    best: SegmentSolution,
    motions: Sequence[Motion],
    workspace: Workspace,
    *,
    stages: Sequence[DescentStage],
) -> SegmentSolution:
    """Solve from motions that differ from a solution on some frames, and return the likelier of both.

    In a long segment they are solved from on these frames and those beside them alone; the motion of the others stays.

    Parameters
    ----------
    problem : SegmentProblem
    noise : SegmentNoise
    best : SegmentSolution
        Measured under the noise.
    motions : sequence of Motion
        F poses per performer.
    workspace : Workspace
    stages : sequence of DescentStage
        From the motions to the solution.
    """
    local = LocalTrial.around(problem, noise, best.motions, motions) if is_long(problem) else None
    if local is not None:
        both = (local.of(best.motions), local.of(motions))
        here, there = (descend(local.problem, one, workspace.silent(), stages, local.noise) for one in both)
        if likeliest(local.problem, local.noise, here, there) is here:
            return best
        assert best.evidence is not None
        motions = local.within(best.motions, there.motions)
        other = solution_at(problem, motions, best.evidence.sampling, workspace, noise.sigma)
        return likeliest(problem, noise, best, replace(other, variances=best.variances))
    return likeliest(problem, noise, best, descend(problem, motions, workspace, stages, noise))


def held_excerpt(
    problem: SegmentProblem,
    first: int,
    stop: int,
    held: int = HELD_FRAMES,
    ends: tuple[bool, bool] = (True, True),
) -> SegmentProblem:
    """Return frames first to stop - 1 of a segment as a problem of their own; so many of them at each of the `ends`
    that is not the segment's are fixed.
    """
    own, still = excerpt(problem, first, stop), np.zeros(stop - first, dtype=bool)
    still[:held] = ends[0] and first > 0
    still[stop - first - held :] |= ends[1] and stop < problem.length
    return replace(own, fixed=tuple(fixed | still[:, None] for fixed in own.fixed))


def stretch_of(problem: SegmentProblem, stretch: Stretch, held: int = HELD_FRAMES) -> SegmentProblem:
    """Return a held excerpt with views of its frames alone: caches keep the first frames of a view."""
    own = held_excerpt(problem, stretch.first, stretch.last + 1, held, stretch.held)
    return replace(own, views=tuple(view.between(own.first, own.first + own.length - 1) for view in own.views))


def stretches_around(problem: SegmentProblem, flags: Bools) -> list[Stretch]:
    """Return the frames of a long segment around flagged ones (F,), with those beside them that may adapt to a change,
    in the order in which they are to be solved.

    What is longer than the longest segment that is solved in one piece is parted into windows (`_windows`).
    """
    F, beside = problem.length, _frames_beside(problem)
    found = adjacent_joined((max(first - beside, 0), min(last + beside, F - 1)) for first, last in runs(flags))
    return [window for first, last in found for window in _windows(first, last, beside)]


def _windows(first: int, last: int, beside: int) -> list[Stretch]:
    """Part a range of frames into windows that overlap by as much as may adapt on both sides of a change.

    They are solved from both ends of the range towards its middle: each begins from the motion that the one before it
    led to, and its other end, where the motion is still in doubt, is free; the last one joins both ways.
    """
    length, overlap = _longest_piece(beside), 2 * beside
    count = max(-(-(last + 1 - first - overlap) // (length - overlap)), 1)
    places = np.rint(np.linspace(first, last + 1 - overlap, count + 1)).astype(int).tolist()
    ranges = [(a, b + overlap - 1) for a, b in pairwise(places)]
    order = sorted(range(count), key=lambda k: min(k, count - 1 - k))
    middle = order[-1]
    return [Stretch(*ranges[k], (k <= middle, k >= middle)) for k in order]


def stretch_around(problem: SegmentProblem, first: int, last: int) -> Stretch:
    """Return frames `first` to `last` with those beside them that may adapt to a change."""
    beside = _frames_beside(problem)
    return Stretch(max(first - beside, 0), min(last + beside, problem.length - 1))


def is_long(problem: SegmentProblem) -> bool:
    """Whether a segment is so long that a moment of it, with the frames beside it, is a small part of it."""
    return longest_piece(problem) <= problem.length


def can_be_parted(problem: SegmentProblem) -> bool:
    """Whether moments of a segment can be solved apart from the rest: it is long, and of a single performer whom
    several views show.
    """
    return is_long(problem) and problem.shows_depth and not (problem.among_others or problem.keypoints)


def longest_piece(problem: SegmentProblem) -> int:
    """Number of frames from which on a segment is long."""
    return _longest_piece(_frames_beside(problem))


def _longest_piece(beside: int) -> int:
    """Number of frames from which on a segment is long, by those beside a change that take part in its trial."""
    return LONG_RATIO * 2 * beside


def _frames_beside(problem: SegmentProblem) -> int:
    """Number of frames before and after changed ones that take part in a trial."""
    return HELD_FRAMES + round(ADAPTATION_TIME * problem.fps)
