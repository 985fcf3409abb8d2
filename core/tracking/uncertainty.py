"""Uncertainty: how far every joint may be from where the tracker has it.

Three things make it up. The covariance of the poses is the inverse of the solver's normal matrix; what moves is less
sure (`joint_covariances.growth_by_speed`), and the shot itself shows a ratio for every part: how far key poses are
missed that were not used (`core.tracking.held_out_keys`).
What no footage can show is added: how well the body stands for the performer (`core.tracking.body_uncertainty`). And
the solution may be the wrong one: foreground that is left uncovered, and limbs that cover background
(`core.tracking.lost_limbs`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..body import Body
from ..evidence.misfit import measured_misfit
from ..numerics.arrays import Array, Bools
from ..numerics.error_lengths import length_quantile
from .held_out_keys import USUAL_RATIO, covariance_ratios, missed_key_poses
from .joint_covariances import growth_by_speed, tip_covariances, tip_jacobian
from .lost_limbs import confirmed_parts, limb_reach, lost_probabilities
from .solvers.gauss_newton import evidence_equations
from .solvers.measurement import hidden_parts, keypoint_instants, measured_at, poses_by_delay
from .solvers.problem import SegmentProblem, SegmentSolution
from .solvers.smoothness_factor import SegmentSmoothness

MISPLACED = 2.0
"""Error of a joint per gap between the outlines: what is misplaced are a few limbs, the gap is the whole outline's."""
INTERVAL = 0.9
"""Share of the errors that the interval holds."""
MAYBE = 0.5
"""Probability from which a part is said to be lost, perhaps."""
TAILS = 20.0
"""Degrees of freedom of the errors' t distribution: the ratio that the key poses show is one of all frames, and the
errors of some are larger."""


@dataclass(frozen=True, eq=False)
class SegmentUncertainty:
    """What a segment's solution leaves uncertain of one performer.

    Attributes
    ----------
    first : int
        Shot frame of the first of the F frames.
    held : ndarray of bool, shape (F,)
        Frames with a key pose of the whole body.
    covariances : ndarray, shape (F, P, 3, 3)
        Of the places of all tips, as the solver expects them, metres squared.
    misses : ndarray, shape (K, P)
        How far key poses were missed that were not used, see `core.tracking.held_out_keys`.
    gaps : ndarray, shape (F,)
        How far the performer's outlines lie outside of the model's, metres.
    lost : ndarray, shape (F, P)
        Probability that a part is lost.
    """

    first: int
    held: Bools
    covariances: Array
    misses: Array
    gaps: Array
    lost: Array

    def ratios(self, body: Body) -> Array:
        """Squared errors of the parts' tips over those that the solver predicts, as this segment's key poses alone show
        them, shape (P,); at most the usual ratio, since key poses that are missed by more may be off themselves.
        """
        return np.minimum(covariance_ratios(self.misses, joint_parts(body.parents)), USUAL_RATIO)


@dataclass(frozen=True, eq=False)
class JointErrors:
    """Expected errors of the places of all parts' tips on F frames; zero where a key pose holds the whole body.

    Attributes
    ----------
    deviation : ndarray, shape (F, P)
        Expected distance from the true place, metres.
    interval : ndarray, shape (F, P)
        The distance that the true one is within in 90 % of cases, metres.
    lost : ndarray, shape (F, P)
        Probability that the part is not on what it is taken for.
    """

    deviation: Array
    interval: Array
    lost: Array

    def with_reach(self, reach: Mapping[int, float]) -> JointErrors:
        """The errors with those of unknown parts, which may be anywhere within their reach, metres by part."""
        parts, far = list(reach), list(reach.values())
        found = [values.copy() for values in (self.deviation, self.interval, self.lost)]
        for values, value in zip(found, (far, far, 0.0), strict=True):
            values[:, parts] = value
        return JointErrors(*found)

    def maybe_lost(self) -> Bools:
        """Where a part may be lost, shape (F, P)."""
        return np.asarray(self.lost >= MAYBE)


def segment_uncertainties(
    problem: SegmentProblem, solution: SegmentSolution, threads: int = 1
) -> list[SegmentUncertainty]:
    """What a segment's solution leaves uncertain, per performer.

    Parameters
    ----------
    problem : SegmentProblem
        As it was solved.
    solution : SegmentSolution
    threads : int
    """
    motions, spans = solution.motions, problem.spans()
    measured = measured_at(problem, solution)
    hidden = hidden_parts(problem, measured.evidence.share) if problem.settings.prediction else []
    images = evidence_equations(problem, measured, hidden)
    smooth = SegmentSmoothness(solution.variances)
    keys = [problem.whole_keys(i) for i in range(len(problem.bodies))]
    poses = poses_by_delay(problem, measured.instants)
    misfit = measured_misfit(
        problem.views, problem.geometry(), poses, first=problem.first, spans=spans, threads=threads
    )
    gaps = misfit.mean_gaps(keys)
    systems = [images[i] + smooth.blocks(problem, i, motion) for i, motion in enumerate(motions)]
    tied = replace(problem, only=None).tied(systems, motions)
    covariances = tied.by_performer([system.factor().covariances() for system in tied.systems])
    uncertainties = []
    for i, (body, motion, fixed) in enumerate(zip(problem.bodies, motions, problem.fixed, strict=True)):
        held = np.repeat(fixed.all(axis=1)[:, None], len(body), axis=1)
        if problem.keypoints:
            R, T = keypoint_instants(problem, motions).poses
            held |= confirmed_parts(body, problem.keypoints[i], (R[:, spans[i]], T[:, spans[i]]))
        growth = growth_by_speed(body, motion)
        uncertainties.append(
            SegmentUncertainty(
                problem.first,
                fixed.all(axis=1),
                tip_covariances(tip_jacobian(body, motion), covariances[i]) * growth[..., None, None],
                missed_key_poses(problem, solution, images, i, growth),
                gaps[i],
                lost_probabilities(body, misfit, spans[i], held=held, keys=keys[i]),
            )
        )
    return uncertainties


def joint_errors(body: Body, uncertainties: Sequence[SegmentUncertainty], beside: Array) -> JointErrors:
    """The errors of one performer over a whole shot.

    Parameters
    ----------
    body : Body
    uncertainties : sequence of SegmentUncertainty
        Of all segments: together they are F frames.
    beside : ndarray, shape (F, P, 3, 3)
        Covariances of what the footage cannot show, metres squared: how far the joints of the body, as it was fitted,
        lie from the performer's.
    """
    F, P = beside.shape[:2]
    ratios = covariance_ratios(np.concatenate([one.misses for one in uncertainties]), joint_parts(body.parents))
    covariances, lost, held = beside.copy(), np.zeros((F, P)), np.zeros(F, bool)
    for one in uncertainties:
        frames = slice(int(one.first), int(one.first) + len(one.held))
        found = one.covariances * ratios[:, None, None]
        found += ((MISPLACED * one.gaps) ** 2 / 3)[:, None, None, None] * np.eye(3)
        covariances[frames] = beside[frames] + found
        lost[frames], held[frames] = one.lost, one.held
    covariances[held] = 0.0
    lost[held] = 0.0
    reach = np.broadcast_to(limb_reach(body), lost.shape)
    near = np.sqrt(np.maximum(np.trace(covariances, axis1=2, axis2=3), 0.0))
    return JointErrors(
        (1 - lost) * near + lost * reach,
        length_quantile(covariances, INTERVAL, tails=TAILS, gross=lost, gross_length=reach),
        lost,
    )


def expected_errors(deviation: Array, parents: Sequence[int], unknown: Sequence[int] = ()) -> Array:
    """Expected error of every frame, metres, shape (F,): mean over the joints, of deviations (F, P) of all tips.

    A part's tip is a joint where another part begins. The ends of limbs are no joints: how a hand is turned, or a foot,
    is seen so much worse than where it is that they would outweigh all else. Unknown parts are left out.
    """
    return np.asarray(deviation[:, joint_parts(parents, unknown)].mean(axis=1))


def joint_parts(parents: Sequence[int], unknown: Sequence[int] = ()) -> list[int]:
    """Parts that others begin at, without unknown ones; all of them where there is one alone."""
    return sorted({parent for parent in parents if parent >= 0} - set(unknown)) or [0]
