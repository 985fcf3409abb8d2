"""Smoothness of the motion on a segment, including its transition to the known poses before and after it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ....body.acceleration_by_sight import precision_by_sight
from ....body.acceleration_scale import likeliest_scale
from ....body.motion import Motion, stacked
from ....body.smoothness import smoothness
from ....body.smoothness_estimate import AccelerationVariances, ObservedMotion, axis_mobility, estimate_variances
from ....numerics.arrays import Array
from ....numerics.banded_blocks import BandedBlocks
from ....shot.acceleration_prior import given_groups
from .problem import AccelerationSearch, SegmentProblem

USUAL_SCALE_RANGE = (0.05, 1.0)
"""Range of the likeliest scale of all accelerations, relative to usual ones, within which the usual ones are kept. Most
joints rest while a few move, so at usual speed the scale is 0.13 to 0.55; slow motion or a wrong frame rate leads out
of the range."""
SPARSENESS = 3.0
"""Factor by which the accelerations of moving joints exceed the common scale, where that lies below the range and
joints are not estimated one by one."""


@dataclass(frozen=True, eq=False)
class SegmentSmoothness:
    """The current estimate of how smooth the motions of a segment are.

    Attributes
    ----------
    variances : tuple of AccelerationVariances
        Per performer: variances on the frames with neighbours on both sides; known poses beside the segment count as
        neighbours. Empty where variances are not estimated.
    scaled : bool
        Whether the common scale was found to differ from 1, see `AccelerationSearch`.
    kept : bool
        Whether the variances are final.
    """

    variances: tuple[AccelerationVariances, ...] = ()
    scaled: bool = False
    kept: bool = False

    @classmethod
    def start(cls, problem: SegmentProblem) -> SegmentSmoothness:
        """Return the variances before any estimation."""
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
        """Return the next estimate, from the motions and the evidence around them.

        Parameters
        ----------
        problem : SegmentProblem
        motions : sequence of Motion
            F poses per performer.
        evidence : sequence of BandedBlocks
            Per performer: normal equations of all evidence at these motions, without smoothness.
        expected : sequence of ndarray, shape (F, D), optional
            Per performer: means of the accelerations, as predicted for hidden parts; by default zero.
        rounds : int
            Number of iterations of the estimate.
        bursts : bool
            Whether the variances may differ from frame to frame, see `estimate_variances`. They may not in coarse
            stages; usual accelerations that such a stage does not contradict are not final.
        """
        if self.kept:
            return self
        scaling = problem.search is AccelerationSearch.SCALE
        scaling |= problem.search is AccelerationSearch.SCALE_THEN_JOINTS and not self.scaled
        contradicted = not scaling or self.scaled
        found = list(self.variances)
        for i in problem.sought if self.variances else ():
            observed = _observed(problem, i, motions[i], evidence[i], expected[i] if expected else None)
            if scaling:
                found[i], usual = _at_likeliest_scale(problem, i, observed, self.variances[i])
                contradicted |= not usual
            else:
                found[i] = estimate_variances(
                    observed,
                    axis_mobility(problem.bodies[i]),
                    self.variances[i],
                    rounds=rounds,
                    bursts=bursts,
                    root_as_one=problem.among_others or not problem.shows_depth,
                    given=given_groups(problem.bodies[i], problem.settings),
                )
        return SegmentSmoothness(tuple(found), scaled=True) if contradicted else replace(self, kept=bursts)

    def blocks(
        self, problem: SegmentProblem, performer: int, motion: Motion, expected: Array | None = None
    ) -> BandedBlocks:
        """Build the normal equations of the smoothness of one performer's F poses.

        Parameters
        ----------
        problem : SegmentProblem
        performer : int
            Index of the performer.
        motion : Motion
            F poses.
        expected : ndarray, shape (F, D), optional
            Means of the accelerations, as predicted for hidden parts; by default zero.
        """
        known, start = _with_known(problem, performer, motion)
        if self.variances:
            precision = self.variances[performer].precision(axis_mobility(problem.bodies[performer]))
            if len(problem.views) == 1 and len(known) > 2 and problem.search is AccelerationSearch.KEPT:
                precision = _by_sight(problem, performer, known, start, precision)
        else:
            precision = problem.precision(performer)
            if precision.ndim > 1:
                beside = (start, len(known) - start - problem.length)
                precision = np.pad(precision, (beside, (0, 0)), mode="edge")[1:-1]
        if expected is not None:
            expected = _among_known(problem, expected, start, len(known))
        return smoothness(known, precision, expected, problem.known_steps(performer)).cut(start, start + problem.length)


def _by_sight(problem: SegmentProblem, performer: int, known: Motion, start: int, precision: Array) -> Array:
    """Inverse covariances of the accelerations of known poses, of which the first of the segment is at index `start`,
    across the line of sight of the only view and along it.

    They hold once usual accelerations are settled: before that, a limb that is lost would go faster to where it is not.
    """
    within = known[1:-1]
    eye = problem.views[0].camera.centres_world(problem.first + 1 - start, len(within))
    return precision_by_sight(precision, problem.bodies[performer], within, eye)


def _observed(
    problem: SegmentProblem, performer: int, motion: Motion, evidence: BandedBlocks, expected: Array | None
) -> ObservedMotion:
    """Join a performer's F poses, the known poses beside them, and the evidence."""
    known, start = _with_known(problem, performer, motion)
    allowed = None if expected is None else _among_known(problem, expected, start, len(known))
    steps = problem.known_steps(performer)
    return ObservedMotion(known, evidence, problem.fixed[performer], start, allowed, steps)


def _at_likeliest_scale(
    problem: SegmentProblem, performer: int, observed: ObservedMotion, before: AccelerationVariances
) -> tuple[AccelerationVariances, bool]:
    """Return usual accelerations times the likeliest scale, and whether that is a usual one."""
    usual, count = problem.variances(performer), len(before.local)
    precision = AccelerationVariances.constant(usual, count).precision(axis_mobility(problem.bodies[performer]))
    scale = likeliest_scale(observed, precision, guess=float(np.sqrt(before.typical[0] / usual[0])))
    least, most = USUAL_SCALE_RANGE
    larger = SPARSENESS if scale < least and problem.search is AccelerationSearch.SCALE else 1.0
    return AccelerationVariances.constant((larger * scale) ** 2 * usual, count), least <= scale <= most


def _with_known(problem: SegmentProblem, performer: int, motion: Motion) -> tuple[Motion, int]:
    """Return a performer's F poses between the known poses beside them, and the index of the first of the F."""
    before, after = problem.around(performer)
    return stacked([m for m in (before, motion, after) if m is not None]), 0 if before is None else 1


def _known_frames(problem: SegmentProblem, performer: int) -> int:
    return problem.length + sum(side is not None for side in problem.around(performer))


def _among_known(problem: SegmentProblem, accelerations: Array, start: int, count: int) -> Array:
    """Embed accelerations (F, D) in those of all known poses, (count - 2, D)."""
    return np.pad(accelerations, ((start, count - start - problem.length), (0, 0)))[1:-1]
