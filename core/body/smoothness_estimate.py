"""How smooth a movement is, estimated from what is seen of it.

Accelerations are modelled in three levels. On each frame a joint has its own variance of acceleration; over the frames
these variances scatter about a typical one of the joint; over the joints, the typical variances scatter about one of
the body. Each level is an inverse gamma distribution about the next, so that the accelerations of a joint have
Student's t distribution: most of a movement may be quiet, and a throw or a landing in it is a burst, not an error to be
smoothed away. A joint of which little is seen is assumed to be as smooth as the others.

The variances maximise the evidence: each is the sum of squared accelerations over the number of those that are well
determined, gamma = n - sum(Var(a)) / sigma^2, where Var(a) is what the solution leaves uncertain (D. MacKay, Bayesian
interpolation, Neural Computation 4, 1992). Without that correction a smooth solution would call for a smoother one. A
part that the pictures do not show has no influence: its gamma is zero.

If less is known, in one view or between two key poses, only a common scale of all accelerations is estimated
(`core.body.acceleration_scale`).

The unit of time is the frame, so the frame rate that a shot claims does not matter.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..numerics.arrays import Array, Bools
from ..numerics.banded import BandedFactor
from ..numerics.banded_blocks import BandedBlocks, diagonal_groups
from .body import Body
from .motion import Motion
from .smoothness import SecondDifferences, acceleration, limited

ACCELERATIONS_T_DOF = 4.0
"""Degrees of freedom of Student's t."""
POOLING_COUNT = 30.0
"""Number of accelerations at which a joint's own estimate weighs as much as that of all joints: three axes, ten frames.
"""
ROOT_PRIOR_COUNT = 6.0
"""Weight of the root's earlier estimate, as a number of accelerations: it has no other joints to be pooled with."""
ROOT_GROUPS = 2
"""Groups of the root's place: the horizontal axes, and the vertical one, along which weight and jumps accelerate it."""
MIN_MOBILITY = 0.05
"""Lower bound of the acceleration about an axis about which a joint can hardly turn, as a share of the usual one."""
_MIN_VARIANCE = 1e-12  # of what stands still, (rad/frame^2)^2 or (m/frame^2)^2
_POOL_ITERATIONS = 20


@dataclass(frozen=True, eq=False)
class AccelerationVariances:
    """Variances of accelerations, per frame to the fourth, of G groups: the root's place, across and upwards, and every
    part's turn.

    Attributes
    ----------
    typical : ndarray, shape (G,)
        Over all frames, about an axis on which the joint turns freely.
    local : ndarray, shape (N, G)
        On each of the N frames that have neighbours on both sides.
    """

    typical: Array
    local: Array

    @classmethod
    def constant(cls, typical: Array, count: int) -> AccelerationVariances:
        """Variances (G,) that are the same on all of `count` frames."""
        return cls(typical, np.repeat(typical[None], count, axis=0))

    def with_given(self, given: AccelerationVariances, groups: Bools) -> AccelerationVariances:
        """These variances with those of some groups, bool (G,), taken from others."""
        return AccelerationVariances(
            np.where(groups, given.typical, self.typical), np.where(groups, given.local, self.local)
        )

    def typical_accelerations(self, fps: float) -> Array:
        """Typical accelerations, shape (G,): of the root's place in m/s^2, of joints in rad/s^2."""
        return np.asarray(np.sqrt(self.typical) * fps**2)

    def precision(self, mobility: Array) -> Array:
        """Inverse variance of every degree of freedom, shape (N, D); `mobility` as in `axis_mobility`."""
        return precision_of(self.local, mobility)


def precision_of(variances: Array, mobility: Array) -> Array:
    """Inverse variances of the acceleration of each degree of freedom (..., D), from variances of G groups (..., G)."""
    return np.asarray(1 / (np.repeat(variances, group_sizes(len(mobility)), axis=-1) * mobility**2))


def group_sizes(dof: int) -> NDArray[np.int_]:
    """Number of axes of each group, shape (G,): two horizontal ones and the vertical one of the root's place, and three
    of every part's turn.
    """
    return np.array([2, 1, *[3] * (dof // 3 - 1)])


def by_group(values: Array) -> Array:
    """Sum values of all degrees of freedom (..., D) over the axes of each group, shape (..., G)."""
    sizes = group_sizes(values.shape[-1])
    return np.asarray(np.add.reduceat(values, np.cumsum(sizes) - sizes, axis=-1))


def _by_group_of_one_root(values: Array) -> Array:
    """Sum values as `by_group` does, with the sum over all axes of the root's place for each of its groups."""
    sums = by_group(values)
    sums[..., :ROOT_GROUPS] = sums[..., :ROOT_GROUPS].sum(axis=-1, keepdims=True)
    return sums


def axis_mobility(body: Body) -> Array:
    """Acceleration of each degree of freedom as a share of its group's, shape (D,).

    The less a joint can turn about an axis, the smaller its acceleration about it: knees and elbows are almost hinges.
    """
    ranges = np.concatenate([np.ptp(part.limits, axis=1) for part in body.parts])
    return np.concatenate([np.ones(3), np.clip(ranges / np.pi, MIN_MOBILITY, 1)])


def updated_variances(
    before: AccelerationVariances, squares: Array, uncertain: Array, axes: Array, *, bursts: bool = True
) -> AccelerationVariances:
    """Return the next estimate.

    Parameters
    ----------
    before : AccelerationVariances
        The variances with which the motion was solved.
    squares, uncertain : ndarray, shape (N, G)
        The squared accelerations, and their posterior variances, each divided by the squared mobility of its axis and
        summed over the axes of a group.
    axes : ndarray, shape (G,)
        How many of a group's axes are free.
    bursts : bool
        Whether the variances of frames may differ.
    """
    gamma = np.clip(axes - uncertain / before.local, 0, axes)
    total = (squares * before.typical / before.local).sum(axis=0)
    known = gamma.sum(axis=0)
    typical = (POOLING_COUNT * before.typical + total) / (POOLING_COUNT + known)
    root = slice(0, ROOT_GROUPS)
    typical[root] = (ROOT_PRIOR_COUNT * before.typical[root] + total[root]) / (ROOT_PRIOR_COUNT + known[root])
    joints = np.arange(ROOT_GROUPS, len(axes))[axes[ROOT_GROUPS:] > 0]
    if len(joints):
        pool = float(np.exp(np.mean(np.log(before.typical[joints]))))
        for _ in range(_POOL_ITERATIONS):  # the likeliest scale of inverse gamma distributions is the harmonic mean
            pool = 1 / float(np.mean((POOLING_COUNT + known[joints]) / (POOLING_COUNT * pool + total[joints])))
        turns = slice(ROOT_GROUPS, None)
        typical[turns] = (POOLING_COUNT * pool + total[turns]) / (POOLING_COUNT + known[turns])
    typical = np.maximum(typical, _MIN_VARIANCE)
    if not bursts:
        return AccelerationVariances.constant(typical, len(squares))
    return AccelerationVariances(typical, (ACCELERATIONS_T_DOF * typical + squares) / (ACCELERATIONS_T_DOF + gamma))


@dataclass(frozen=True, eq=False)
class ObservedMotion:
    """A motion and all that is known of it but how smooth it is.

    Attributes
    ----------
    known : Motion
        F poses, preceded and followed by the held poses on the frame before and the frame after, if any.
    evidence : BandedBlocks
        Normal equations of all evidence at the F poses, without smoothness.
    fixed : ndarray of bool, shape (F, D)
        Degrees of freedom that key poses fix.
    start : int
        Index of the first of the F poses among the known ones.
    expected : ndarray, shape (N, D), optional
        Accelerations that are predicted, see `smoothness`.
    steps : ndarray, optional
        The time from each known pose to the next, see `smoothness.acceleration`.
    """

    known: Motion
    evidence: BandedBlocks
    fixed: Bools
    start: int = 0
    expected: Array | None = None
    steps: Array | None = None

    def is_fixed(self) -> bool:
        """Whether nothing is left to estimate from: too few poses, or all of them fixed."""
        return len(self.known) < 3 or bool(self.fixed.all())

    def among_free(self, smooth: BandedBlocks) -> BandedBlocks:
        """Return the part of the normal equations of all known poses that concerns the F poses."""
        return smooth.cut(self.start, self.start + len(self.fixed))


def estimate_variances(
    observed: ObservedMotion,
    mobility: Array,
    before: AccelerationVariances,
    *,
    rounds: int = 1,
    bursts: bool = True,
    root_as_one: bool = False,
    given: Bools | None = None,
) -> AccelerationVariances:
    """Estimate how smooth a motion is from what is seen of it.

    Parameters
    ----------
    observed : ObservedMotion
    mobility : ndarray, shape (D,)
        See `axis_mobility`.
    before : AccelerationVariances
        The estimate so far.
    rounds : int
        How often the estimate is repeated with the same evidence.
    bursts : bool
        Whether the variances of frames may differ. Far from the solution they should not: a limb that was mistaken for
        another would be explained as one that jumps at a key pose.
    root_as_one : bool
        Whether all axes of the root's place have one estimate: in a single view, where errors in depth, which is nearly
        horizontal, would pass for movement and the vertical axis for calm, and among several performers, where it lost
        limbs (docs/evidence.md).
    given : ndarray of bool, shape (G,), optional
        Groups whose variances are not estimated.
    """
    if observed.is_fixed():
        return before
    known, fixed, start, expected = observed.known, observed.fixed, observed.start, observed.expected
    grouped = _by_group_of_one_root if root_as_one else by_group
    axes = grouped((~fixed.all(axis=0)).astype(float))
    differences = SecondDifferences.of(known, observed.steps)
    for _ in range(rounds):
        factor, gradient = _factorised(observed, differences.normal_equations(before.precision(mobility), expected))
        step = np.zeros((len(known), fixed.shape[1]))
        step[start : start + len(fixed)] = limited(-factor.solve(gradient))
        diagonal, first, second = (
            _among(blocks, start, len(known) - k)
            for k, blocks in enumerate(factor.covariance_band(kept=diagonal_groups))
        )
        solved = acceleration(known.moved(step), observed.steps) - (0.0 if expected is None else expected)
        uncertain = differences.variances((diagonal, first, second))
        squares, left = (grouped(values / mobility**2) for values in (solved**2, uncertain))
        found = updated_variances(before, squares, left, axes, bursts=bursts)
        before = found if given is None else found.with_given(before, given)
    return before


def _factorised(observed: ObservedMotion, smooth: BandedBlocks) -> tuple[BandedFactor, Array]:
    """Return the factor and the gradient (F, D) of all that is known of a motion, in the arrays of the smoothness."""
    system = observed.among_free(smooth).add(observed.evidence)
    return BandedFactor(system, observed.fixed), system.gradient


def _among(blocks: Array, start: int, count: int) -> Array:
    """Return the blocks placed among those of `count` frames from index `start` on; the other frames are held and get
    zeros.
    """
    out = np.zeros((count, *blocks.shape[1:]))
    out[start : start + len(blocks)] = blocks
    return out
