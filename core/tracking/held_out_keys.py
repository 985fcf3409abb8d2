"""Key poses predicted without themselves: what the shot's own errors are against those that the solver expects.

A key pose at the end of a segment is let go, and the segment solved for it from the evidence and the key pose at the
other end. The ratio of the prediction's error to the solver's covariance for it measures how wrong that covariance is:
through noise that stays correlated for longer than the solver assumes, clothes, cameras that do not fit. The causes
need not be known.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ..numerics.arrays import Array
from ..numerics.banded import BandedFactor
from ..numerics.banded_blocks import BandedBlocks
from .joint_covariances import tip_covariances, tip_jacobian
from .solvers.gauss_newton import OVERRELAXATION
from .solvers.problem import SegmentProblem, SegmentSolution
from .solvers.smoothness_factor import SegmentSmoothness

USUAL_RATIO = 2.0
"""Squared errors against those that the solver expects, where there is no key pose to measure them by."""
KNOWN_RATIO = 6.0
"""What `USUAL_RATIO` counts, in squared errors along an axis."""
VAGUE = 0.5
"""Axes along which a prediction is expected to be so far off are left out, metres."""
ALIKE = 4.0
"""Parts of a body miss a key pose together: so many count as one for the body's ratio."""
OWN_RATIO = 6.0
"""Squared errors along an axis that a part must have shown to count as much as all of the body."""


def missed_key_poses(
    problem: SegmentProblem,
    solution: SegmentSolution,
    images: Sequence[BandedBlocks],
    performer: int,
    growth: Array,
) -> Array:
    """Predict a performer's key poses of a segment that hold the whole body, one at a time.

    Parameters
    ----------
    problem : SegmentProblem
    solution : SegmentSolution
    images : sequence of BandedBlocks
        Normal equations of all evidence at the solution, without smoothness, per performer.
    performer : int
        Index of the performer.
    growth : ndarray, shape (F, P)
        By how much squared errors are larger than the solver expects for what moves.

    Returns
    -------
    ndarray, shape (K, P)
        How far each key pose was missed: squared distance of every part's tip in units of its expected covariance,
        summed over the three axes.
    """
    body, motion = problem.bodies[performer], solution.motions[performer]
    found = []
    for frame in problem.whole_keys(performer).tolist():
        free, smooth = _without_key(problem, solution, performer, frame)
        if free.fixed[performer].all():
            continue
        system = images[performer] + smooth.blocks(free, performer, motion)
        factor = BandedFactor(system, free.fixed[performer])
        # A single step goes as much too short here as in solving.
        step = -OVERRELAXATION * factor.solve(system.gradient)[frame]
        jacobian = tip_jacobian(body, motion[[frame]])[0]
        found.append(_miss(jacobian, step, factor.covariance(frame), growth[frame]))
    return np.array(found).reshape(-1, len(body))


def covariance_ratios(misses: Array, joints: Sequence[int]) -> Array:
    """By what factor covariances of a performer's parts are to be multiplied, shape (P,).

    It is the mean of what is known of the part, of the body, and of shots in general, each counted by how much is
    known.

    Parameters
    ----------
    misses : ndarray, shape (K, P)
        See `missed_key_poses`.
    joints : sequence of int
        Parts whose tips are joints: they stand for the body.
    """
    total, each = misses.sum(axis=0), 3.0 * len(misses)
    body = KNOWN_RATIO * USUAL_RATIO + total[list(joints)].sum() / ALIKE
    body /= KNOWN_RATIO + each * len(joints) / ALIKE
    return np.asarray((OWN_RATIO * body + total) / (OWN_RATIO + each))


def _without_key(
    problem: SegmentProblem, solution: SegmentSolution, performer: int, frame: int
) -> tuple[SegmentProblem, SegmentSmoothness]:
    """The problem with the performer's pose on a frame free, and its smoothness.

    What is known beyond an end is not used: it was found from that end.
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
    """Squared errors (P,) of a step (D,), over the axes along which its covariance (D, D), that of each tip grown by
    speed (P,), determines the tips.
    """
    apart = jacobian @ step
    variances, axes = np.linalg.eigh(tip_covariances(jacobian[None], covariance[None])[0])
    variances = variances * np.broadcast_to(growth, len(variances))[:, None]
    along = np.einsum("pab,pa->pb", axes, apart)
    determined = (variances > 1e-6 * variances[:, -1:]) & (variances < VAGUE**2)
    squares = np.where(determined, along**2 / np.maximum(variances, 1e-30), 0.0).sum(axis=1)
    count = determined.sum(axis=1)
    return np.asarray(np.where(count > 0, 3 * squares / np.maximum(count, 1), 3 * USUAL_RATIO))
