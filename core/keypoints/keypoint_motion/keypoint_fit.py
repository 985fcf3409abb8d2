"""A motion fitted to keypoints alone: poses of all frames, the keypoints' offsets, and the body's measures at once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ...body import Body, part_poses
from ...body.joint_limits import habitual_prior, posture_prior
from ...body.measures.body_measures import BodyMeasures
from ...body.motion import Motion
from ...body.smoothness import MAX_STEP, limited, smoothness
from ...body.smoothness_estimate import (
    AccelerationVariances,
    ObservedMotion,
    axis_mobility,
    by_group,
    estimate_variances,
    group_sizes,
)
from ...numerics.arrays import Array
from ...numerics.banded import BandedFactor, bordered_solution
from ...numerics.banded_blocks import BandedBlocks
from ...numerics.repeatable import on_grid
from ..keypoint_factor import keypoint_system
from ..keypoint_offsets import KeypointOffsets
from ..keypoint_rays import Keypoints
from ..keypoint_sigmas import USUAL_SIGMA, robust_energy
from ..seen_landmarks import habit_precision, usual_turns
from ..view_agreement import ViewAgreement
from .keypoint_comparison import CountedKeypoints, FitStep, compared
from .measures_fit import with_measures

STEPS_FROM_START = (
    *[FitStep(4.0, CountedKeypoints.AGREED)] * 2,
    *[FitStep(2.0, CountedKeypoints.BOTH)] * 2,
    *[FitStep(1.0, CountedKeypoints.BOTH)] * 3,
    *[FitStep(1.0, CountedKeypoints.FITTING)] * 3,
)
"""The iterations from a start that may be far off."""
STEPS_CONTINUED = (FitStep(2.0, CountedKeypoints.BOTH), *[FitStep(1.0, CountedKeypoints.FITTING)] * 3)
"""The iterations from an earlier fit some of whose limbs were posed anew."""
REPEATED_POSES = 4.0
"""A detector's errors repeat when a pose does. For unknowns that are the same on all frames (offsets, measures), the
frames therefore count this many times less than if errors were only correlated in time. With complete key poses the
factor is not applied, as these show the constants by themselves."""
START_SCALE = 4.0
"""The estimate of smoothness starts with this many times the usual accelerations, because movement that is smoothed
away at the start cannot be found again."""


@dataclass(frozen=True, eq=False)
class FitProblem:
    """What a motion of F frames is fitted to.

    Attributes
    ----------
    agreement : ViewAgreement
        The keypoints that the motion is fitted to, and what the views agree on.
    fixed : ndarray of bool, shape (F, D)
        Degrees of freedom that are known.
    precision : ndarray, shape (D,)
        Inverse variances of usual accelerations, see `core.body.smoothness.smoothness`. If views agree on keypoints,
        the fit starts from these and estimates how smooth the motion is.
    correlated : float
        Number of neighbouring frames that have the same error. It lowers the weight of the frames for unknowns that are
        the same on all of them. The weight for the motion is lowered only with a single view, which cannot tell such
        errors from movement.
    """

    agreement: ViewAgreement
    fixed: NDArray[np.bool_]
    precision: Array
    correlated: float = 1.0

    def on_frames(self, frames: slice) -> FitProblem:
        """Return the problem on some of the frames alone."""
        return replace(self, agreement=self.agreement[frames], fixed=self.fixed[frames])

    @property
    def keypoints(self) -> Keypoints:
        """The keypoints that the motion is fitted to, on F frames."""
        return self.agreement.keypoints

    @property
    def views_agree(self) -> bool:
        """Whether two views agree on any keypoint, which shows the detector's errors independently of the motion."""
        return self.agreement.sigma is not None

    @property
    def weight(self) -> float:
        """Weight of a keypoint, at most 1."""
        return 1.0 if self.views_agree else 1.0 / self.correlated

    @property
    def prior_weight(self) -> float:
        """Factor of the prior of the unknowns that are the same on all frames."""
        return self.correlated * self.weight * (1.0 if self.fixed.all(axis=1).any() else REPEATED_POSES)

    def usual_variances(self, mobility: Array, frames: int) -> AccelerationVariances:
        """Return the variances from which the estimate of smoothness starts; if views agree on nothing, they are
        kept.
        """
        typical = by_group(1 / (self.precision * mobility**2)) / group_sizes(len(mobility))
        widened = typical * START_SCALE**2 if self.views_agree else typical
        return AccelerationVariances.constant(widened, max(frames - 2, 0))


@dataclass(frozen=True, eq=False)
class KeypointFit:
    """A motion that was fitted to keypoints, with what the keypoints say about it.

    Attributes
    ----------
    body : Body
    motion : Motion
        F poses.
    places : KeypointOffsets
        Positions of the keypoints on the body, including their offsets.
    keypoints : Keypoints
        Left and right corrected.
    changed : ndarray of bool, shape (V, F, L)
        Where left and right were exchanged.
    sigma : ndarray, shape (V, L)
        Standard deviations of the detector, metres, from the disagreement of the views, or, with one view, from the
        residuals of the motion.
    weights : ndarray, shape (V, F, L)
        Robust weights, 1 for a keypoint of full confidence that fits.
    energy : float
        The final energy of keypoints and joint limits. It is computed with the same standard deviation for all
        keypoints, so that fits from several starts can be compared.
    agreed : ndarray, shape (V, F, L), or None
        Confidence of the keypoints that agree with those of other views, else 0; None where no views agree on any.
    variances : AccelerationVariances
        Estimated variances of accelerations, or the usual ones if no views agree on any keypoint.
    measures : BodyMeasures or None
        The measures of the body, if they were fitted.
    imagined : Keypoints or None
        If only a single view has keypoints: those of an imagined view from the side, which hold the depths.
    """

    body: Body
    motion: Motion
    places: KeypointOffsets
    keypoints: Keypoints
    changed: NDArray[np.bool_]
    sigma: Array
    weights: Array
    energy: float
    agreed: Array | None
    variances: AccelerationVariances
    measures: BodyMeasures | None = None
    imagined: Keypoints | None = None


@dataclass(frozen=True, eq=False)
class _Estimate:
    """The current estimates of the unknowns of a fit, and of how smooth the motion is."""

    body: Body
    motion: Motion
    places: KeypointOffsets
    variances: AccelerationVariances
    measures: BodyMeasures | None

    def on_grid(self, problem: FitProblem) -> _Estimate:
        """Return the estimate where it is the same on every processor, with the surfaces of its body."""
        motion, measures = (
            self.motion.on_grid(problem.fixed),
            None if self.measures is None else self.measures.on_grid(),
        )
        body = self.body if measures is None else measures.body()
        places = replace(self.places, offsets=on_grid(self.places.offsets)).on_body(body, problem.keypoints.names)
        return _Estimate(body, motion, places, self.variances, measures)


def fit_motion(
    problem: FitProblem,
    body: Body,
    start: Motion,
    *,
    measures: BodyMeasures | None = None,
    steps: Sequence[FitStep] = STEPS_FROM_START,
    earlier: KeypointFit | None = None,
) -> KeypointFit:
    """Fit the motion on all frames and the keypoints' offsets by robust least squares, from coarse to fine.

    Parameters
    ----------
    problem : FitProblem
    body : Body
    start : Motion
        F poses.
    measures : BodyMeasures, optional
        The measures of the body, if these are to be fitted too.
    steps : sequence of FitStep
    earlier : KeypointFit, optional
        An earlier fit, whose body, offsets, measures and smoothness are the start.
    """
    mobility = axis_mobility(body)
    if earlier is None:
        variances = problem.usual_variances(mobility, len(start))
        found = _Estimate(body, start, KeypointOffsets.on(body, problem.keypoints.names), variances, measures)
    else:
        found = _Estimate(earlier.body, start, earlier.places, earlier.variances, earlier.measures)
    # This is plain Gauss-Newton rather than `core.numerics.least_squares`: the keypoints that count, their sides and
    # the smoothness change with every iteration, so there is no common cost by which a step could be tested.
    for i, step in enumerate(steps):
        smoothness_known = problem.views_agree and (i > 0 or earlier is not None)
        found = _iterated(problem, found, step, mobility=mobility, estimates_smoothness=smoothness_known)
    return _finished(problem, found.on_grid(problem))


def _iterated(
    problem: FitProblem, found: _Estimate, step: FitStep, *, mobility: Array, estimates_smoothness: bool
) -> _Estimate:
    """Return the estimates after one Gauss-Newton step."""
    body, motion, places, measures = found.body, found.motion, found.places, found.measures
    poses = part_poses(body, motion)
    comparison = compared(problem.agreement, places.world(poses), step.tolerance)
    sided = comparison.keypoints
    weights = comparison.counting(step) * problem.weight
    system = keypoint_system(body, poses, sided, places, weights, prior_weight=problem.prior_weight)
    evidence = system.blocks + _pose_prior(body, motion, problem.agreement)
    variances = found.variances
    if estimates_smoothness:
        variances = estimate_variances(ObservedMotion(motion, evidence, problem.fixed), mobility, variances)
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
    # Of what keypoints say little about, as the twist of a stretched arm, the linear model asks for steps far beyond
    # where it holds: they would lead to and fro without end, and each would multiply the roundings of those before.
    blocks = (evidence + smoothness(motion, variances.precision(mobility))).near(MAX_STEP)
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
    """Return the fit of a final estimate."""
    body, motion, places = found.body, found.motion, found.places
    comparison = compared(problem.agreement, places.world(part_poses(body, motion)))
    usual = np.full_like(comparison.sigma, USUAL_SIGMA)
    energy = robust_energy(comparison.residual, comparison.keypoints.confidence, usual)
    return KeypointFit(
        body,
        motion,
        places,
        comparison.keypoints,
        comparison.changed,
        comparison.sigma,
        weights=comparison.fitting() * comparison.sigma[:, None] ** 2,
        energy=energy + posture_prior(body, motion).energy,
        agreed=comparison.agreed,
        variances=found.variances,
        measures=found.measures,
    )


def _pose_prior(body: Body, motion: Motion, agreement: ViewAgreement) -> BandedBlocks:
    """Normal equations of the pose prior: joint limits, posture, and the usual rotation of limbs out of sight."""
    precision = habit_precision(body, agreement.keypoints, agreement.fps)
    return posture_prior(body, motion) + habitual_prior(motion, precision, usual_turns(motion, precision))
