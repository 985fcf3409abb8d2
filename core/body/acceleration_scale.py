"""The common scale of all accelerations of a motion, where too little is seen to estimate that of each joint.

It maximises the marginal likelihood: the motion is integrated out, so that a scale is not preferred because some motion
fits it well, but because the evidence is likely under it.
"""

from __future__ import annotations

import numpy as np

from ..numerics.arrays import Array
from ..numerics.banded import BandedFactor
from .smoothness import SecondDifferences
from .smoothness_estimate import ObservedMotion

SCALE_STEP = 2.0
"""Ratio between neighbouring scales of accelerations that are compared."""
MAX_SCALE_STEPS = 7
"""Largest number of steps from the scale at which the search begins."""
LOG_SCALE_SIGMA = np.log(8.0)
"""Prior standard deviation of the logarithm of the scale. It covers wrongly stated frame rates, slow motion and
kicks."""


def likeliest_scale(observed: ObservedMotion, precision: Array, guess: float = 1.0) -> float:
    """Return the most likely common factor of all accelerations relative to given ones.

    Parameters
    ----------
    observed : ObservedMotion
    precision : ndarray, shape (N, D)
        Inverse variances of the accelerations, with a factor of one.
    guess : float
        Where the search begins.

    Returns
    -------
    float
        The factor of standard deviations, not of variances. The best of a series of factors in steps of two is refined
        by the parabola through it and its neighbours.
    """
    if observed.is_fixed():
        return 1.0
    cost_of = _CostOfScale(observed, precision)
    costs: dict[int, float] = {}

    def cost(step: int) -> float:
        if step not in costs:
            costs[step] = cost_of(guess * SCALE_STEP**step)
        return costs[step]

    best = 0
    while abs(best) < MAX_SCALE_STEPS:
        lower = min((best - 1, best + 1), key=cost)
        if cost(lower) >= cost(best):
            break
        best = lower
    before, here, after = cost(best - 1), cost(best), cost(best + 1)
    bend = before + after - 2 * here
    shift = float(np.clip((before - after) / (2 * bend), -0.5, 0.5)) if bend > 0 else 0.0
    return float(guess * SCALE_STEP ** (best + shift))


class _CostOfScale:
    """Minus twice the logarithm of the marginal likelihood of a scale and of its prior, but for what is constant."""

    def __init__(self, observed: ObservedMotion, precision: Array) -> None:
        self._observed = observed
        self._smooth = SecondDifferences.of(observed.known, observed.steps).normal_equations(
            precision, observed.expected
        )
        self._inside = observed.among_free(self._smooth)
        self._count = (len(observed.known) - 2) * (~observed.fixed).any(axis=0).sum()

    def __call__(self, scale: float) -> float:
        system = self._inside.scaled(scale**-2).add(self._observed.evidence)
        factor = BandedFactor(system, self._observed.fixed)
        gained = float(np.sum(system.gradient * factor.solve(system.gradient)))
        likelihood = (
            self._smooth.energy / scale**2 - gained + factor.log_determinant() + 2 * self._count * np.log(scale)
        )
        return float(likelihood + (np.log(scale) / LOG_SCALE_SIGMA) ** 2)
