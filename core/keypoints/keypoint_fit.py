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
class FitProblem:
    """What a motion of F frames is fitted to.

    Attributes
    ----------
    agreement : ViewAgreement
        Of the keypoints that the motion is fitted to.
    fixed : ndarray of bool, shape (F, D)
        Degrees of freedom that are known.
    precision : ndarray, shape (D,)
        Of accelerations as is usual, see `core.body.smoothness.smoothness`. Where views agree on keypoints, the fit
        estimates how smooth the motion is from there on.
    correlated : float
        How many neighbouring frames err together. Errors that last say little about what is the same on all frames, but
        nothing against quick movement; only a single view, which cannot tell the two apart, is given less weight.
    """

    agreement: ViewAgreement
    fixed: NDArray[np.bool_]
    precision: Array
    correlated: float = 1.0

    @property
    def keypoints(self) -> Keypoints:
        """The keypoints that the motion is fitted to, on F frames."""
        return self.agreement.keypoints

    @property
    def views_agree(self) -> bool:
        """Whether two views agree on any keypoint: then the detector's errors are known apart from the motion."""
        return self.agreement.deviation is not None

    @property
    def weight(self) -> float:
        """What a keypoint counts."""
        return 1.0 if self.views_agree else 1.0 / self.correlated

    @property
    def prior_weight(self) -> float:
        """What is known beforehand of what is the same on all frames counts so many times."""
        return self.correlated * self.weight * (1.0 if self.fixed.all(axis=1).any() else REPEATED_POSES)

    def usual_variances(self, mobility: Array, frames: int) -> AccelerationVariances:
        """Where the estimation of smoothness begins, and where views agree on nothing, ends."""
        typical = (1 / (self.precision * mobility**2)).reshape(-1, 3).mean(axis=1)
        widened = typical * WIDER_START**2 if self.views_agree else typical
        return AccelerationVariances.constant(widened, max(frames - 2, 0))


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
    imagined : Keypoints or None
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
    imagined: Keypoints | None = None


@dataclass(frozen=True, eq=False)
class _Estimate:
    """The unknowns of a fit, and how smooth the motion was found to be so far."""

    body: Body
    motion: Motion
    places: Places
    variances: AccelerationVariances
    measures: BodyMeasures | None


def fit_motion(
    problem: FitProblem,
    body: Body,
    start: Motion,
    *,
    measures: BodyMeasures | None = None,
    steps: Sequence[FitStep] = FROM_START,
    earlier: KeypointFit | None = None,
) -> KeypointFit:
    """Fit the motion of all frames, and the keypoints' offsets, by robust least squares from coarse to fine.

    Parameters
    ----------
    problem : FitProblem
    body : Body
    start : Motion
        F poses.
    measures : BodyMeasures, optional
        Those of the body, which are then fitted as well.
    steps : sequence of FitStep
    earlier : KeypointFit, optional
        Fit whose body, offsets, measures and smoothness are taken over.
    """
    mobility = axis_mobility(body)
    if earlier is None:
        variances = problem.usual_variances(mobility, len(start))
        found = _Estimate(body, start, Places.on(body, problem.keypoints.names), variances, measures)
    else:
        found = _Estimate(earlier.body, start, earlier.places, earlier.variances, earlier.measures)
    # Which keypoints count, their sides and the smoothness change from one iteration to the next, so no cost is common
    # to two of them by which `core.numerics.least_squares` could test a step: plain Gauss-Newton.
    for i, step in enumerate(steps):
        smoothness_known = problem.views_agree and (i > 0 or earlier is not None)
        found = _iterated(problem, found, step, mobility=mobility, estimates_smoothness=smoothness_known)
    if found.measures is not None:
        found = replace(found, body=found.measures.body())
    return _finished(problem, found)


def _iterated(
    problem: FitProblem, found: _Estimate, step: FitStep, *, mobility: Array, estimates_smoothness: bool
) -> _Estimate:
    """The estimate after one step of Gauss-Newton."""
    body, motion, places, measures = found.body, found.motion, found.places, found.measures
    poses = part_poses(body, motion)
    comparison = compared(problem.agreement, places.world(poses), step.tolerance)
    sided = comparison.keypoints
    weights = comparison.counting(step) * problem.weight
    system = keypoint_system(body, poses, sided, places, weights, prior_weight=problem.prior_weight)
    evidence = system.blocks + _pose_prior(body, motion, problem.agreement)
    variances = found.variances
    if estimates_smoothness:
        variances = estimate_variances(motion, evidence, problem.fixed, mobility, variances)
    if measures is not None:
        system = with_measures(
            system,
            measures,
            motion,
            keypoints=sided,
            places=places,
            weights=weights,
            prior_weight=problem.prior_weight,
        )
    blocks = evidence + smoothness(motion, variances.precision(mobility))
    moved, others = bordered_solution(
        BandedFactor(blocks, problem.fixed), blocks.gradient, system.border, system.corner, system.gradient
    )
    count = places.offsets.size
    places = replace(places, offsets=places.offsets - others[:count].reshape(-1, 3))
    if measures is not None:
        measures = measures.changed(-others[count:])
        body = measures.body(solid=False)
        places = places.on_body(body, problem.keypoints.names)
    return _Estimate(body, motion.moved(-limited(moved)), places, variances, measures)


def _finished(problem: FitProblem, found: _Estimate) -> KeypointFit:
    """A fit with what its keypoints say of it."""
    body, motion, places = found.body, found.motion, found.places
    comparison = compared(problem.agreement, places.world(part_poses(body, motion)))
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
        variances=found.variances,
        measures=found.measures,
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


def compared(agreement: ViewAgreement, points: Array, tolerance: float = 1.0) -> Comparison:
    """Compare keypoints with those of a motion, in the world; far from the solution, sides stay as they are."""
    sided, changed = agreement.keypoints, np.zeros(agreement.confidence.shape, bool)
    if tolerance <= SIDES_TOLERANCE:
        sided, changed = correct_sides(sided, points)
    residual = sided.residuals(points)
    if agreement.deviation is None:
        return Comparison(sided, changed, residual, deviations(residual, sided.confidence), None)
    return Comparison(sided, changed, residual, agreement.deviation, np.where(changed, 0.0, agreement.confidence))


def _pose_prior(body: Body, motion: Motion, agreement: ViewAgreement) -> BandedBlocks:
    """What is known of poses beforehand: joint limits, posture, and how limbs out of sight are usually turned."""
    precision = habit_precision(body, agreement.keypoints, agreement.fps)
    return posture_prior(body, motion) + habitual_prior(motion, precision, usual_turns(motion, precision))
