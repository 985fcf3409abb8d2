"""The normal equations of a segment: evidence of all views, keypoints, and priors.

Residuals of brightness constancy (paper 1, equation (12)) have a standard deviation per view, estimated robustly from
the residuals themselves, and neighbouring pixels are correlated. The accelerations of joints and root are normally
distributed, with variances of human motion. Image gradients couple the poses of neighbouring frames, and accelerations
those of three frames in a row, so the normal matrix is block-pentadiagonal.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ....body.joint_blocks import joint_blocks
from ....body.motion import Motion
from ....body.smoothness import acceleration
from ....evidence.segment_evidence import SegmentEvidence
from ....numerics.arrays import Array
from ....numerics.banded_blocks import BandedBlocks
from ....shot.settings import Settings
from ..unseen_parts.prediction import predict_unseen
from .contact_factor import with_contact
from .curve_factor import with_curves
from .measurement import Instants, MeasuredMotion, hidden_parts, keypoint_instants
from .problem import SegmentProblem, SegmentSolution
from .smoothness_factor import SegmentSmoothness
from .weighted_evidence import WeightedEvidence, pixel_precision

PAIRS_AT_ONCE = 64
"""Number of pairs of frames whose normal equations are built at a time."""


@dataclass(frozen=True, eq=False)
class SegmentNoise:
    """The noise of the images, estimated at certain motions. Only costs under the same noise can be compared.

    Attributes
    ----------
    sigma : ndarray, shape (V, F - 1, 1 + P)
        Standard deviation of the grey-level residuals of each pair of frames, and of each of its parts, 0 to 1.
    weight : ndarray, shape (V, F - 1)
        Weight of the mean squared residual of each pair in the cost.
    share : ndarray, shape (V,)
        Number of independent observations that a pixel of full-resolution footage stands for, whatever the stride; see
        `SegmentEvidence.pixel_share`.
    """

    sigma: Array
    weight: Array
    share: Array

    @classmethod
    def of(cls, evidence: SegmentEvidence, settings: Settings) -> SegmentNoise:
        """Estimate the noise from evidence."""
        sums = evidence.gradients
        weight = pixel_precision(evidence, settings) * sums.count
        return cls(sums.noise, weight, evidence.pixel_share(settings.lengths[0]) / evidence.sampling.stride**2)


def with_priors(
    problem: SegmentProblem,
    motions: Sequence[Motion],
    images: Sequence[BandedBlocks],
    smooth: SegmentSmoothness,
    expected: Sequence[Array] = (),
) -> list[BandedBlocks]:
    """Add the priors to the normal equations of the evidence, in their arrays: smoothness, and stiff parts near the key
    poses' curve.

    Parameters
    ----------
    problem : SegmentProblem
    motions : sequence of Motion
    images : sequence of BandedBlocks
        Per performer: normal equations of the evidence at these motions.
    smooth : SegmentSmoothness
    expected : sequence of ndarray, shape (F, D)
        Per performer: means of the accelerations, as predicted for hidden parts; by default zero.
    """
    systems = list(images)
    for i in problem.sought:
        systems[i] = images[i].add(smooth.blocks(problem, i, motions[i], expected[i] if expected else None))
    return with_curves(problem, systems, tuple(motions))


def with_priors_at(
    problem: SegmentProblem, solution: SegmentSolution, images: Sequence[BandedBlocks], expected: Sequence[Array] = ()
) -> list[BandedBlocks]:
    """Add to the normal equations of the evidence at a solution, in their arrays, what else it minimises but plants and
    holds: the priors of `with_priors`, with the solution's own smoothness, and contact. Parameters as there.
    """
    motions = solution.motions
    systems = with_priors(problem, motions, images, SegmentSmoothness(solution.variances), expected)
    return with_contact(systems, problem.contact, problem.bodies, motions, problem.sought)


def hidden_and_expected(
    problem: SegmentProblem, motions: Sequence[Motion], evidence: SegmentEvidence
) -> tuple[list[NDArray[np.bool_]], list[Array]]:
    """Return, per performer, which parts no view shows, (F, P), and the accelerations predicted for them, (F, D).

    See `hidden_parts` and `predicted_accelerations`. Both lists are empty where prediction is switched off.
    """
    if not problem.settings.prediction:
        return [], []
    hidden = hidden_parts(problem, evidence.share)
    return hidden, predicted_accelerations(motions, hidden, problem.sought, problem.steps)


def evidence_equations(
    problem: SegmentProblem,
    measured: MeasuredMotion,
    hidden: Sequence[NDArray[np.bool_]] = (),
    noise: SegmentNoise | None = None,
) -> list[BandedBlocks]:
    """Build the normal equations of the evidence: gradients and outlines of all views, and keypoints.

    Those of performers whose motion is given are zero.

    Parameters
    ----------
    problem : SegmentProblem
    measured : MeasuredMotion
        The motions and the evidence at them.
    hidden : sequence of ndarray of bool, shape (F, P)
        Per performer: parts whose pixels are left out, paper 1, equation (38).
    noise : SegmentNoise, optional
        Noise under which the cost of the gradients is computed; by default it is estimated from the evidence.

    Returns
    -------
    list of BandedBlocks
        One per performer.
    """
    noise = noise or SegmentNoise.of(measured.evidence, problem.settings)
    weighted = WeightedEvidence.of(problem, measured.evidence, hidden)
    systems = [BandedBlocks.zeros(problem.length, body.dof) for body in problem.bodies]
    for instants in measured.instants:
        for i, own in _image_systems(problem, instants, weighted, noise).items():
            systems[i] = own.add(systems[i])
    if problem.keypoints:
        instants = keypoint_instants(problem, measured.motions)
        R, T = instants.poses
        spans = problem.spans()
        for i in problem.sought:
            at = R[:, spans[i]], T[:, spans[i]]
            seen = problem.keypoints[i].blocks(problem.bodies[i], at, measured.evidence.sampling.tolerance)
            systems[i] += instants.on_frames(i, seen)
    return systems


def _image_systems(
    problem: SegmentProblem, instants: Instants, weighted: WeightedEvidence, noise: SegmentNoise
) -> dict[int, BandedBlocks]:
    """Normal equations of gradients and outlines, by performer that is solved for: of views with the same instants.

    They are built for some frames at a time: the sums of all parts of a long segment would take much memory.
    """
    (R, T), views = instants.poses, instants.views
    energy = weighted.energy(views, noise.weight)
    spans, systems = problem.spans(), {}
    for i in problem.sought:
        empty = BandedBlocks.zeros(problem.length, problem.bodies[i].dof)
        systems[i] = replace(empty, energy=energy / len(problem.sought))
    for first in range(0, problem.length - 1, PAIRS_AT_ONCE):
        stop = min(first + PAIRS_AT_ONCE, problem.length - 1)
        H, g = weighted.paired_sums(views, first, stop)
        for i in problem.sought:
            span, frames = spans[i], slice(first, stop + 1)
            own = joint_blocks(problem.bodies[i], (R[frames, span], T[frames, span]), H[:, span], g[:, span], 0.0)
            systems[i] = systems[i].add(own, first)
    return {i: instants.on_frames(i, system) for i, system in systems.items()}


def predicted_accelerations(
    motions: Sequence[Motion],
    hidden: Sequence[NDArray[np.bool_]],
    sought: Sequence[int],
    steps: Array | None = None,
) -> list[Array]:
    """Return, per performer, the accelerations (F, D) of hidden parts in the motion that is predicted for them.

    They are zero for parts that are seen, and for performers that are not solved for.
    """
    expected = []
    for i, (motion, mask) in enumerate(zip(motions, hidden, strict=True)):
        predicted = np.zeros((len(motion), 3 + 3 * mask.shape[1]))
        if i in sought and mask.any() and len(motion) > 2:
            predicted[1:-1] = acceleration(predict_unseen(motion, mask), steps)
        degrees = np.concatenate([np.repeat(mask[:, :1], 3, axis=1), np.repeat(mask, 3, axis=1)], axis=1)
        expected.append(predicted * degrees)
    return expected
