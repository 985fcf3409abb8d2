"""Cross-validation on key poses: the actual errors of a shot relative to those that the solver expects.

The key pose at one end of a segment is released, and predicted from the evidence and the key pose at the other end. The
squared error of the prediction over the solver's covariance for it shows by what factor that covariance is too small,
whatever the cause: correlated noise, clothes, inexact cameras.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ...numerics.arrays import Array
from ...numerics.banded import BandedFactor
from ...numerics.banded_blocks import BandedBlocks
from ..solvers.approach import OVERRELAXATION
from ..solvers.equations.problem import SegmentProblem, SegmentSolution
from ..solvers.equations.smoothness_factor import SegmentSmoothness
from .joint_covariances import tip_covariances, tip_jacobian

USUAL_RATIO = 2.0
"""Ratio of squared errors to expected ones where no key pose measures it."""
USUAL_RATIO_COUNT = 6.0
"""Weight of `USUAL_RATIO`, as a number of squared errors along an axis."""
MAX_EXPECTED_ERROR = 0.5
"""Axes along which the expected error of a prediction is larger than this are left out, metres."""
PARTS_PER_OBSERVATION = 4.0
"""Number of parts that count as one observation for the ratio of the body, as parts miss a key pose together."""
BODY_RATIO_COUNT = 6.0
"""Number of squared errors along an axis at which a part's own ratio weighs as much as that of the body."""


def missed_key_poses(
    problem: SegmentProblem,
    solution: SegmentSolution,
    images: Sequence[BandedBlocks],
    performer: int,
    growth: Array,
) -> Array:
    """Predict the whole-body key poses of a performer at the ends of a segment, one at a time, without using them.

    Parameters
    ----------
    problem : SegmentProblem
    solution : SegmentSolution
    images : sequence of BandedBlocks
        Normal equations of all evidence at the solution, without smoothness, per performer.
    performer : int
        Index of the performer.
    growth : ndarray, shape (F, P)
        Factor on expected squared errors by the speed of each part, see `joint_covariances.growth_by_speed`.

    Returns
    -------
    ndarray, shape (K, P)
        Squared distance of every part's tip from each key pose in units of its expected covariance, summed over the
        three axes.
    """
    body, motion = problem.bodies[performer], solution.motions[performer]
    found = []
    for frame in problem.whole_keys(performer).tolist():
        free, smooth = _without_key(problem, solution, performer, frame)
        if free.fixed[performer].all():
            continue
        system = smooth.blocks(free, performer, motion).add(images[performer])
        factor = BandedFactor(system, free.fixed[performer])
        # A single step goes as much too short here as in solving.
        step = -OVERRELAXATION * factor.solve(system.gradient)[frame]
        jacobian = tip_jacobian(body, motion[[frame]])[0]
        found.append(_miss(jacobian, step, factor.covariance(frame), growth[frame]))
    return np.array(found).reshape(-1, len(body))


def covariance_ratios(misses: Array, joints: Sequence[int]) -> Array:
    """Factors by which the covariances of a performer's parts are multiplied, shape (P,).

    Each is a weighted mean of the ratios of the part, of the whole body, and of shots in general.

    Parameters
    ----------
    misses : ndarray, shape (K, P)
        See `missed_key_poses`.
    joints : sequence of int
        Parts whose tips are joints; the ratio of the body is taken over these.
    """
    total, each = misses.sum(axis=0), 3.0 * len(misses)
    body = USUAL_RATIO_COUNT * USUAL_RATIO + total[list(joints)].sum() / PARTS_PER_OBSERVATION
    body /= USUAL_RATIO_COUNT + each * len(joints) / PARTS_PER_OBSERVATION
    return np.asarray((BODY_RATIO_COUNT * body + total) / (BODY_RATIO_COUNT + each))


def _without_key(
    problem: SegmentProblem, solution: SegmentSolution, performer: int, frame: int
) -> tuple[SegmentProblem, SegmentSmoothness]:
    """Return the problem with the performer's pose on a frame released, and its smoothness.

    Poses known beyond the segment's ends are left out, as they were found from these key poses.
    """
    fixed, variances = problem.fixed[performer].copy(), solution.variances
    fixed[frame] = problem.fixed[performer].all(axis=0)
    free = replace(problem, fixed=tuple(fixed if i == performer else f for i, f in enumerate(problem.fixed)))
    if frame == 0 and free.before is not None:
        free, variances = replace(free, before=None), tuple(replace(v, local=v.local[1:]) for v in variances)
    if frame == problem.length - 1 and free.after is not None:
        free, variances = replace(free, after=None), tuple(replace(v, local=v.local[:-1]) for v in variances)
    return free, SegmentSmoothness(variances)


def _miss(jacobian: Array, step: Array, covariance: Array, growth: Array | float = 1.0) -> Array:
    """Squared error of each tip after a step (D,) in units of its covariance, (P,), over the axes on which the
    covariance (D, D), times `growth` (P,), determines the tip; see `MAX_EXPECTED_ERROR`.
    """
    apart = jacobian @ step
    variances, axes = np.linalg.eigh(tip_covariances(jacobian[None], covariance[None])[0])
    variances = variances * np.broadcast_to(growth, len(variances))[:, None]
    along = np.einsum("pab,pa->pb", axes, apart)
    determined = (variances > 1e-6 * variances[:, -1:]) & (variances < MAX_EXPECTED_ERROR**2)
    squares = np.where(determined, along**2 / np.maximum(variances, 1e-30), 0.0).sum(axis=1)
    count = determined.sum(axis=1)
    return np.asarray(np.where(count > 0, 3 * squares / np.maximum(count, 1), 3 * USUAL_RATIO))
