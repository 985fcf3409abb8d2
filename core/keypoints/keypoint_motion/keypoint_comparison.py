"""Keypoints compared with those of a motion: how far off each is, on which side, and how much it counts."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

import numpy as np
from numpy.typing import NDArray

from ...numerics.arrays import Array
from ..keypoint_rays import Keypoints
from ..keypoint_sigmas import robust_weights, sigmas, trusted_weights
from ..left_and_right.left_right import correct_sides
from ..view_agreement import ViewAgreement

SIDES_TOLERANCE = 2.0
"""Left and right are corrected once the tolerance has come down to this: before, the motion may be farther off than the
limbs are from each other."""


class CountedKeypoints(Enum):
    """Which keypoints count in an iteration."""

    AGREED = "those that views agree on: no limb is caught by another's keypoints"
    BOTH = "those that views agree on, and the others where they fit"
    FITTING = "each by its own error: views may agree on something wrong"


@dataclass(frozen=True)
class FitStep:
    """One iteration of a fit: which keypoints count, and how far off they may be.

    The tolerance is a factor of the standard deviations in the robust kernel; above 1 far from the solution, where
    errors are large.
    """

    tolerance: float
    counted: CountedKeypoints


@dataclass(frozen=True, eq=False)
class Comparison:
    """Keypoints compared with those of a motion.

    Attributes
    ----------
    keypoints : Keypoints
        Left and right corrected.
    changed : ndarray of bool, shape (V, F, L)
        Where left and right were exchanged.
    residual : ndarray, shape (V, F, L, 2)
        See `Keypoints.residuals`.
    sigma : ndarray, shape (V, L)
        Standard deviations of the detector, metres.
    agreed : ndarray, shape (V, F, L), or None
        Confidence of the keypoints that agree with those of other views, else 0; None where no views agree on any.
    """

    keypoints: Keypoints
    changed: NDArray[np.bool_]
    residual: Array
    sigma: Array
    agreed: Array | None

    def fitting(self, tolerance: float = 1.0) -> Array:
        """Weights of the keypoints, shape (V, F, L), by the residual of each."""
        return robust_weights(self.residual, self.keypoints.confidence, self.sigma, tolerance)

    def counting(self, step: FitStep) -> Array:
        """Weights of the keypoints, shape (V, F, L), in one iteration of the fit."""
        if self.agreed is None or step.counted is CountedKeypoints.FITTING:
            return self.fitting(step.tolerance)
        trusted = trusted_weights(self.residual, self.agreed, self.sigma, step.tolerance)
        return trusted if step.counted is CountedKeypoints.AGREED else np.maximum(self.fitting(step.tolerance), trusted)


def compared(agreement: ViewAgreement, points: Array, tolerance: float = 1.0) -> Comparison:
    """Compare keypoints with a motion's, which are at `points` (F, L, 3) in the world, metres.

    If the tolerance is above `SIDES_TOLERANCE`, left and right stay as they are.
    """
    sided, changed = agreement.keypoints, np.zeros(agreement.confidence.shape, bool)
    if tolerance <= SIDES_TOLERANCE:
        sided, changed = correct_sides(sided, points)
    residual = sided.residuals(points)
    if agreement.sigma is None:
        return Comparison(sided, changed, residual, sigmas(residual, sided.confidence), None)
    return Comparison(sided, changed, residual, agreement.sigma, np.where(changed, 0.0, agreement.confidence))
