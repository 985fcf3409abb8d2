"""Smoothness of a segment's motion, with the poses that are known before and after it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...body.motion import Motion, stacked
from ...body.smoothness import smoothness
from ...body.smoothness_estimate import AccelerationVariances, axis_mobility, estimate_variances, likeliest_scale
from ...numerics.arrays import Array
from ...numerics.banded_blocks import BandedBlocks
from ...shot.acceleration_prior import given_groups
from .problem import AccelerationSearch, SegmentProblem

TRUSTED = (0.05, 1.0)
"""The usual accelerations stay where the likeliest common value is such a share of them: most joints rest while a few
move, so that on shots of the usual speed it is 0.13 to 0.55. Slow motion or a wrong frame rate leads out of that."""
SPARSENESS = 3.0
"""How much larger the accelerations of the joints that move are than a likeliest common value below that, where the
joints' own are not estimated."""


@dataclass(frozen=True, eq=False)
class SegmentSmoothness:
    """How smooth the motions of a segment are, as it was estimated so far; per performer.

    Attributes
    ----------
    variances : tuple of AccelerationVariances
        On the frames with neighbours on both sides, those held beside the segment included. Empty where they are not
        estimated.
    scaled : bool
        Whether the pictures have shown the scale of all of them, where that is looked for.
    kept : bool
        Whether they are not estimated any more.
    """

    variances: tuple[AccelerationVariances, ...] = ()
    scaled: bool = False
    kept: bool = False

    @classmethod
    def start(cls, problem: SegmentProblem) -> SegmentSmoothness:
        """Before the pictures are looked at."""
        if problem.acceleration_precision is not None or problem.typical_variances is None:
            return cls()
        return cls(
            tuple(
                AccelerationVariances.constant(problem.variances(i), max(_known_frames(problem, i) - 2, 0))
                for i in range(len(problem.bodies))
            ),
            kept=problem.search is AccelerationSearch.KEPT,
        )

    def estimated(
        self,
        problem: SegmentProblem,
        motions: Sequence[Motion],
        evidence: Sequence[BandedBlocks],
        expected: Sequence[Array] = (),
        *,
        rounds: int = 1,
        bursts: bool = True,
    ) -> SegmentSmoothness:
        """The next estimate, if there is one.

        Parameters
        ----------
        problem : SegmentProblem
        motions : sequence of Motion
            F poses per performer.
        evidence : sequence of BandedBlocks
            Normal equations of all evidence around them, without smoothness.
        expected : sequence of ndarray, shape (F, D), optional
            Accelerations that cost nothing.
        rounds : int
            Times that it is repeated.
        bursts : bool
            Whether frames differ, see `estimate_variances`.
        """
        if self.kept:
            return self
        scaling = problem.search is AccelerationSearch.SCALE
        scaling |= problem.search is AccelerationSearch.SCALE_THEN_JOINTS and not self.scaled
        contradicted = not scaling or self.scaled
        found = []
        for i, before in enumerate(self.variances):
            if i not in problem.sought:
                found.append(before)
                continue
            known, start = _with_known(problem, i, motions[i])
            allowed = _among_known(problem, expected[i], start, len(known)) if expected else None
            mobility, count = axis_mobility(problem.bodies[i]), len(before.local)
            if scaling:
                usual = problem.variances(i)
                scale = likeliest_scale(
                    known,
                    evidence[i],
                    problem.fixed[i],
                    AccelerationVariances.constant(usual, count).precision(mobility),
                    start=start,
                    expected=allowed,
                    guess=float(np.sqrt(before.typical[0] / usual[0])),
                )
                larger = SPARSENESS if scale < TRUSTED[0] and problem.search is AccelerationSearch.SCALE else 1.0
                contradicted |= not TRUSTED[0] <= scale <= TRUSTED[1]
                found.append(AccelerationVariances.constant((larger * scale) ** 2 * usual, count))
                continue
            found.append(
                estimate_variances(
                    known,
                    evidence[i],
                    problem.fixed[i],
                    mobility,
                    before,
                    start=start,
                    expected=allowed,
                    rounds=rounds,
                    bursts=bursts,
                    given=given_groups(problem.bodies[i], problem.settings),
                )
            )
        return SegmentSmoothness(tuple(found), scaled=True) if contradicted else replace(self, kept=True)

    def blocks(
        self, problem: SegmentProblem, performer: int, motion: Motion, expected: Array | None = None
    ) -> BandedBlocks:
        """Normal equations of the accelerations of one performer's F poses.

        Parameters
        ----------
        problem : SegmentProblem
        performer : int
            Index of the performer.
        motion : Motion
            F poses.
        expected : ndarray, shape (F, D), optional
            Accelerations that cost nothing, in the middle of the frame before and the next; by default none.
        """
        known, start = _with_known(problem, performer, motion)
        if self.variances:
            precision = self.variances[performer].precision(axis_mobility(problem.bodies[performer]))
        else:
            precision = problem.precision(performer)
            if precision.ndim > 1:
                beside = (start, len(known) - start - problem.length)
                precision = np.pad(precision, (beside, (0, 0)), mode="edge")[1:-1]
        if expected is not None:
            expected = _among_known(problem, expected, start, len(known))
        return smoothness(known, precision, expected).cut(start, start + problem.length)


def _with_known(problem: SegmentProblem, performer: int, motion: Motion) -> tuple[Motion, int]:
    """A performer's F poses with those that are known beside them, and where the F begin."""
    before, after = problem.around(performer)
    return stacked([m for m in (before, motion, after) if m is not None]), 0 if before is None else 1


def _known_frames(problem: SegmentProblem, performer: int) -> int:
    return problem.length + sum(side is not None for side in problem.around(performer))


def _among_known(problem: SegmentProblem, accelerations: Array, start: int, count: int) -> Array:
    """Accelerations (F, D) among those of all poses known, (count - 2, D)."""
    return np.pad(accelerations, ((start, count - start - problem.length), (0, 0)))[1:-1]
