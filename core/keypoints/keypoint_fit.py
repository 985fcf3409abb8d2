"""A motion fitted to keypoints alone: poses of all frames, the keypoints' offsets, and the body's measures at once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import Enum

import numpy as np
from numpy.typing import NDArray

from ..body import Body, part_poses
from ..body.joint_limits import habitual_prior, posture_prior
from ..body.motion import Motion
from ..body.smoothness import limited, smoothness
from ..body.smoothness_estimate import AccelerationVariances, axis_mobility, estimate_variances
from ..numerics.arrays import Array
from ..numerics.banded import BandedFactor, bordered_solution
from ..numerics.banded_blocks import BandedBlocks
from .body_measures import BodyMeasures, with_measures
from .keypoint_factor import (
    USUAL_DEVIATION,
    Keypoints,
    Places,
    deviations,
    keypoint_system,
    robust_energy,
    robust_weights,
    trusted_weights,
)
from .left_right import correct_sides
from .seen_landmarks import habit_precision, usual_turns
from .view_agreement import ViewAgreement


class Counted(Enum):
    """Which keypoints count in an iteration."""

    AGREED = "those that views agree on: no limb is caught by another's keypoints"
    BOTH = "those that views agree on, and the others where they fit"
    FITTING = "each by its own error: views may agree on something wrong"


@dataclass(frozen=True)
class FitStep:
    """One iteration of a fit.

    Attributes
    ----------
    tolerance : float
        Above 1, far from the solution, larger errors still count.
    counted : Counted
    """

    tolerance: float
    counted: Counted


FROM_START = (
    *[FitStep(4.0, Counted.AGREED)] * 2,
    *[FitStep(2.0, Counted.BOTH)] * 2,
    *[FitStep(1.0, Counted.BOTH)] * 3,
    *[FitStep(1.0, Counted.FITTING)] * 3,
)
"""The iterations from a start that may be far off."""
CONTINUED = (FitStep(2.0, Counted.BOTH), *[FitStep(1.0, Counted.FITTING)] * 3)
"""The iterations from an earlier fit some of whose limbs were posed anew."""
SIDES_TOLERANCE = 2.0
"""Sides are corrected when the tolerance has come down to this: before, the start may be farther off than the limbs are
apart."""
REPEATED_POSES = 4.0
"""A detector's errors repeat with the pose: for what is the same on all frames (offsets, measures), so many times fewer
frames count than if the errors were only correlated in time. Whole key poses show these constants by themselves."""
WIDER_START = 4.0
"""The estimate of smoothness begins with accelerations so many times the usual: what is smoothed away is lost to it."""


@dataclass(frozen=True, eq=False)
class KeypointFit:
    """A motion fitted to keypoints. Everything in it belongs to that motion.

    Attributes
    ----------
    body : Body
    motion : Motion
        F poses.
    places : Places
        Of the keypoints on the body, offsets included.
    keypoints : Keypoints
        With their sides corrected.
    changed : ndarray of bool, shape (V, F, L)
        Where they were changed.
    deviation : ndarray, shape (V, L)
        The detector's, metres: as the views' disagreement shows it, or with one view the motion's residuals.
    weights : ndarray, shape (V, F, L)
        Robust weights, 1 for a sure keypoint that fits.
    energy : float
        What keypoints and joint limits leave, with one usual deviation of all keypoints: so the fits of several starts
        can be compared.
    agreed : ndarray, shape (V, F, L), or None
        Confidence of the keypoints that agree with those of other views, else 0; None where no views agree on any.
    variances : AccelerationVariances
        How smooth the motion is: as estimated, or where no views agree on any keypoints, as is usual.
    measures : BodyMeasures or None
        Those of the body, where they were fitted.
    aside : Keypoints or None
        Of an imagined view from the side that holds the depths, where a single view has keypoints.
    """

    body: Body
    motion: Motion
    places: Places
    keypoints: Keypoints
    changed: NDArray[np.bool_]
    deviation: Array
    weights: Array
    energy: float
    agreed: Array | None
    variances: AccelerationVariances
    measures: BodyMeasures | None = None
    aside: Keypoints | None = None


def fit_motion(
    body: Body,
    keypoints: Keypoints,
    start: Motion,
    *,
    fixed: NDArray[np.bool_],
    precision: Array,
    correlated: float = 1.0,
    measures: BodyMeasures | None = None,
    agreement: ViewAgreement | None = None,
    steps: Sequence[FitStep] = FROM_START,
    earlier: KeypointFit | None = None,
) -> KeypointFit:
    """Fit the motion of all frames, and the keypoints' offsets, by robust least squares from coarse to fine.

    Parameters
    ----------
    body : Body
    keypoints : Keypoints
        On F frames.
    start : Motion
        F poses.
    fixed : ndarray of bool, shape (F, D)
        Degrees of freedom that are known.
    precision : ndarray, shape (D,)
        Of accelerations as is usual, see `core.body.smoothness.smoothness`. Where views agree on keypoints, the fit
        estimates how smooth the motion is from there on.
    correlated : float
        How many neighbouring frames err together. Errors that last say little about what is the same on all frames, but
        nothing against quick movement; only a single view, which cannot tell the two apart, is given less weight.
    measures : BodyMeasures, optional
        Those of the body, which are then fitted as well.
    agreement : ViewAgreement, optional
        Of the same keypoints.
    steps : sequence of FitStep
    earlier : KeypointFit, optional
        Fit whose body, offsets, measures and smoothness are taken over.
    """
    known = None if agreement is None else agreement.deviation
    mobility = axis_mobility(body)
    weight = 1.0 / correlated if known is None else 1.0
    prior_weight = correlated * weight * (1.0 if fixed.all(axis=1).any() else REPEATED_POSES)
    motion, places = start, Places.on(body, keypoints.names)
    typical = (1 / (precision * mobility**2)).reshape(-1, 3).mean(axis=1)
    widened = typical if known is None else typical * WIDER_START**2
    variances = AccelerationVariances.constant(widened, max(len(motion) - 2, 0))
    if earlier is not None:
        body, places, variances, measures = earlier.body, earlier.places, earlier.variances, earlier.measures
    # Which keypoints count, their sides and the smoothness change from one iteration to the next, so no cost is common
    # to two of them by which `core.numerics.least_squares` could test a step: plain Gauss-Newton.
    for i, step in enumerate(steps):
        poses = part_poses(body, motion)
        comparison = compared(keypoints, places.world(poses), agreement, step.tolerance)
        sided = comparison.keypoints
        weights = comparison.counting(step) * weight
        system = keypoint_system(body, poses, sided, places, weights, prior_weight=prior_weight)
        evidence = system.blocks + _pose_prior(body, motion, agreement)
        if known is not None and (i > 0 or earlier is not None):
            variances = estimate_variances(motion, evidence, fixed, mobility, variances)
        if measures is not None:
            system = with_measures(
                system,
                measures,
                motion,
                keypoints=sided,
                places=places,
                weights=weights,
                prior_weight=prior_weight,
            )
        blocks = evidence + smoothness(motion, variances.precision(mobility))
        moved, others = bordered_solution(
            BandedFactor(blocks, fixed), blocks.gradient, system.border, system.corner, system.gradient
        )
        motion = motion.moved(-limited(moved))
        count = places.offsets.size
        places = replace(places, offsets=places.offsets - others[:count].reshape(-1, 3))
        if measures is not None:
            measures = measures.changed(-others[count:])
            body = measures.body(solid=False)
            places = places.on_body(body, keypoints.names)
    if measures is not None:
        body = measures.body()
    comparison = compared(keypoints, places.world(part_poses(body, motion)), agreement)
    usual = np.full_like(comparison.deviation, USUAL_DEVIATION)
    energy = robust_energy(comparison.residual, comparison.keypoints.confidence, usual)
    return KeypointFit(
        body,
        motion,
        places,
        comparison.keypoints,
        comparison.changed,
        comparison.deviation,
        weights=comparison.fitting() * comparison.deviation[:, None] ** 2,
        energy=energy + posture_prior(body, motion).energy,
        agreed=comparison.agreed,
        variances=variances,
        measures=measures,
    )


@dataclass(frozen=True, eq=False)
class Comparison:
    """Keypoints beside a motion's.

    Attributes
    ----------
    keypoints : Keypoints
        With their sides corrected.
    changed : ndarray of bool, shape (V, F, L)
        Where they were changed.
    residual : ndarray
        See `Keypoints.residuals`.
    deviation : ndarray, shape (V, L)
        The detector's, metres.
    agreed : ndarray, shape (V, F, L), or None
        Confidence of the keypoints that agree with those of other views, else 0; None where no views agree on any.
    """

    keypoints: Keypoints
    changed: NDArray[np.bool_]
    residual: Array
    deviation: Array
    agreed: Array | None

    def fitting(self, tolerance: float = 1.0) -> Array:
        """Weights of the keypoints, shape (V, F, L), each by its own error."""
        return robust_weights(self.residual, self.keypoints.confidence, self.deviation, tolerance)

    def counting(self, step: FitStep) -> Array:
        """Weights of the keypoints, shape (V, F, L), in one iteration."""
        if self.agreed is None or step.counted is Counted.FITTING:
            return self.fitting(step.tolerance)
        trusted = trusted_weights(self.residual, self.agreed, self.deviation, step.tolerance)
        return trusted if step.counted is Counted.AGREED else np.maximum(self.fitting(step.tolerance), trusted)


def compared(
    keypoints: Keypoints, points: Array, agreement: ViewAgreement | None, tolerance: float = 1.0
) -> Comparison:
    """Compare keypoints with those of a motion, in the world; far from the solution, sides stay as they are."""
    known = None if agreement is None else agreement.deviation
    sided, changed = keypoints, np.zeros(keypoints.confidence.shape, bool)
    if tolerance <= SIDES_TOLERANCE:
        sided, changed = correct_sides(keypoints, points)
    residual = sided.residuals(points)
    deviation = deviations(residual, sided.confidence) if known is None else known
    agreed = None if agreement is None or known is None else np.where(changed, 0.0, agreement.confidence)
    return Comparison(sided, changed, residual, deviation, agreed)


def _pose_prior(body: Body, motion: Motion, agreement: ViewAgreement | None) -> BandedBlocks:
    """What is known of poses beforehand: joint limits, posture, and how limbs out of sight are usually turned."""
    prior = posture_prior(body, motion)
    if agreement is None:
        return prior
    precision = habit_precision(body, agreement.keypoints, agreement.fps)
    return prior + habitual_prior(motion, precision, usual_turns(motion, precision))
