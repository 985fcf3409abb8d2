"""Expected errors of the tracked joints.

They have three components. The first is the covariance of the poses, the inverse of the solver's normal matrix. It
grows with speed (`joint_covariances.growth_by_speed`), and is multiplied for each part by a ratio that is estimated
from the shot, by predicting key poses without using them (`held_out_keys`). The second is what no footage
can show: how far the body's joints are from the performer's (`body_uncertainty`). The third is the
possibility that the solution is wrong, which uncovered foreground and limbs on the background indicate
(`lost_limbs`, `lost_body`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...body import Body
from ...body.limbs import numbered_limbs
from ...evidence.misfit import bare_shares
from ...evidence.view_work import ViewWork
from ...numerics.arrays import Array, Bools
from ...numerics.banded_blocks import BandedBlocks
from ...numerics.error_lengths import length_quantile
from ...runtime.processes.freed_memory import return_freed_memory
from ..solvers.assessment.solution_doubts import misfit_at
from ..solvers.equations.measurement import LONG, MeasuredMotion, keypoint_instants, measured_at, poses_by_delay
from ..solvers.equations.problem import SegmentProblem, SegmentSolution
from ..solvers.equations.segment_equations import evidence_equations, hidden_and_expected, with_priors_at
from ..solvers.equations.smoothness_factor import SegmentSmoothness
from ..solvers.equations.view_delays import DelayEvidence, delay_evidence
from ..solvers.limb_evidence.limb_support import support_of_parts
from .held_out_keys import USUAL_RATIO, covariance_ratios, missed_key_poses
from .joint_covariances import growth_by_speed, tip_covariances, tip_jacobian
from .lost_body import lost_body_probabilities
from .lost_limbs import confirmed_parts, lost_lengths, lost_probabilities
from .wide_clothes import widths_of_clothes

ERROR_PER_GAP = 2.0
"""Ratio of a joint's error to the mean gap between the outlines: a few misplaced limbs cause the gap of the whole."""
COVERAGE = 0.9
"""Fraction of the errors that the interval should contain."""
REPORTED_PROBABILITY = 0.5
"""Probability from which a part is reported as possibly lost."""
ERRORS_T_DOF = 8.0
"""Degrees of freedom of the errors' t distribution, as the ratio estimated from key poses is a mean over frames with
smaller and larger errors."""
ONE_VIEW_RATIO = 0.25
"""Ratio of squared errors to those that the solver expects in a single view without keypoints. Most of these errors are
in depth, and key poses that are predicted without themselves hardly tell how large they are."""
ONE_VIEW_T_DOF = 4.0
"""Degrees of freedom there: most joints are right, and some are far off along the line of sight."""


@dataclass(frozen=True, eq=False)
class SegmentUncertainty:
    """The uncertainty of a segment's solution for one performer.

    Attributes
    ----------
    first : int
        Shot frame of the first of the F frames.
    held : ndarray of bool, shape (F,)
        Frames with a key pose of the whole body.
    covariances : ndarray, shape (F, P, 3, 3)
        Covariances of the positions of all tips according to the solver, metres squared.
    misses : ndarray, shape (K, P)
        Errors of key poses predicted without themselves, see `held_out_keys`.
    gaps : ndarray, shape (F,)
        Mean distance of the performer's outlines outside the model's, metres.
    lost : ndarray, shape (F, P)
        Probability that each part is lost.
    clothes : ndarray, shape (P,)
        How far each part may be elsewhere in wide clothes, metres, see `wide_clothes`.
    """

    first: int
    held: Bools
    covariances: Array
    misses: Array
    gaps: Array
    lost: Array
    clothes: Array

    def ratios(self, body: Body) -> Array:
        """Return the ratios of squared errors of the parts' tips to those that the solver predicts, shape (P,),
        estimated from this segment's key poses alone; at most the usual ratio, as key poses with larger errors may be
        wrong.
        """
        return np.minimum(covariance_ratios(self.misses, joint_parts(body.parents)), USUAL_RATIO)


@dataclass(frozen=True, eq=False)
class JointErrors:
    """Expected errors of the positions of all parts' tips on F frames; zero where a key pose holds the whole body.

    Attributes
    ----------
    deviation : ndarray, shape (F, P)
        Expected distance from the true position, metres.
    interval : ndarray, shape (F, P)
        Distance that should not be exceeded in 90 % of cases, metres.
    lost : ndarray, shape (F, P)
        Probability that the part is lost: it does not lie on the performer's.
    """

    deviation: Array
    interval: Array
    lost: Array

    def with_reach(self, reach: Mapping[int, float]) -> JointErrors:
        """Return the errors with those of unknown parts, which may be anywhere within a reach, metres by part."""
        parts, far = list(reach), list(reach.values())
        found = [values.copy() for values in (self.deviation, self.interval, self.lost)]
        for values, value in zip(found, (far, far, 0.0), strict=True):
            values[:, parts] = value
        return JointErrors(*found)

    def maybe_lost(self) -> Bools:
        """Return where each part may be lost, shape (F, P)."""
        return np.asarray(self.lost >= REPORTED_PROBABILITY)

    def body_maybe_lost(self) -> Bools:
        """Return where the whole body may be lost, shape (F,)."""
        return np.asarray(self.maybe_lost()[:, 0])

    def parts_maybe_lost(self) -> Bools:
        """Return where each part may be lost though the whole body is not, shape (F, P)."""
        return np.asarray(self.maybe_lost() & ~self.body_maybe_lost()[:, None])


def segment_uncertainties(
    problem: SegmentProblem, solution: SegmentSolution, by: ViewWork
) -> tuple[list[SegmentUncertainty], DelayEvidence, list[BandedBlocks]]:
    """Return the uncertainty of a segment's solution for every performer, what its footage says about delays, and the
    normal equations of every performer at the solution, without those of plants and holds.

    Parameters
    ----------
    problem : SegmentProblem
        The problem that was solved.
    solution : SegmentSolution
    by : ViewWork
    """
    if problem.length >= LONG:
        return_freed_memory(in_cycles=True)
    motions, spans = solution.motions, problem.spans()
    measured = measured_at(problem, solution)
    whole = replace(problem, only=None)
    hidden, expected = hidden_and_expected(whole, motions, measured.evidence)
    images = evidence_equations(problem, measured, hidden)
    keys = [problem.whole_keys(i) for i in range(len(problem.bodies))]
    misfit = solution.misfit or misfit_at(problem, motions, by)
    gaps = misfit.mean_gaps(keys)
    covariances = _pose_covariances(whole, solution, images)
    clothes = widths_of_clothes(problem, motions)
    bare = _bare_shares(problem, measured, by)
    support = None if problem.shows_depth or problem.keypoints else support_of_parts(whole, motions)
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
                lost_probabilities(
                    body,
                    misfit,
                    spans[i],
                    held=held,
                    keys=keys[i],
                    bare=bare,
                    support=None if support is None else support[i],
                    whole=lost_body_probabilities(problem, solution, i, held),
                ),
                clothes[i],
            )
        )
    equations = with_priors_at(whole, solution, images, expected)
    return uncertainties, delay_evidence(problem, measured, hidden, whole.tied(equations, motions)), equations


def _bare_shares(problem: SegmentProblem, measured: MeasuredMotion, by: ViewWork) -> Array:
    """Return the share of each part that is seen before nothing but background, (V, F, P), see `misfit.bare_shares`."""
    poses = poses_by_delay(problem, measured.instants)
    limb_of = numbered_limbs(problem.bodies)
    return bare_shares(problem.views, problem.geometry(), poses, first=problem.first, limb_of=limb_of, by=by)


def _pose_covariances(
    whole: SegmentProblem, solution: SegmentSolution, images: Sequence[BandedBlocks]
) -> dict[int, Array]:
    """Return the covariances of every performer's poses, (F, D, D), by the evidence and the smoothness."""
    smooth, motions = SegmentSmoothness(solution.variances), solution.motions
    systems = [smooth.blocks(whole, i, motion).add(images[i]) for i, motion in enumerate(motions)]
    tied = whole.tied(systems, motions)
    return tied.by_performer([system.factor().covariances() for system in tied.systems])


def joint_errors(
    body: Body, uncertainties: Sequence[SegmentUncertainty], beside: Array, *, one_view: bool = False
) -> JointErrors:
    """Return the expected errors of one performer over a whole shot.

    Parameters
    ----------
    body : Body
    uncertainties : sequence of SegmentUncertainty
        Those of all segments, which together have F frames.
    beside : ndarray, shape (F, P, 3, 3)
        Additional covariances, metres squared, of what the footage cannot show: the distances of the fitted body's
        joints from the performer's.
    one_view : bool
        Whether a single view without keypoints shows the performer.
    """
    F, P = beside.shape[:2]
    if one_view:
        ratios, tails = np.full(P, ONE_VIEW_RATIO), ONE_VIEW_T_DOF
    else:
        misses = np.concatenate([one.misses for one in uncertainties])
        ratios, tails = covariance_ratios(misses, joint_parts(body.parents)), ERRORS_T_DOF
    covariances, lost, held = beside.copy(), np.zeros((F, P)), np.zeros(F, bool)
    for one in uncertainties:
        frames = slice(int(one.first), int(one.first) + len(one.held))
        found = one.covariances * ratios[:, None, None]
        found += ((ERROR_PER_GAP * one.gaps) ** 2 / 3)[:, None, None, None] * np.eye(3)
        found += (one.clothes**2 / 3)[:, None, None] * np.eye(3)
        covariances[frames] = beside[frames] + found
        lost[frames], held[frames] = one.lost, one.held
    covariances[held] = 0.0
    lost[held] = 0.0
    far = lost_lengths(body, lost)
    near = np.sqrt(np.maximum(np.trace(covariances, axis1=2, axis2=3), 0.0))
    return JointErrors(
        (1 - lost) * near + lost * far,
        length_quantile(covariances, COVERAGE, tails=tails, gross=lost, gross_length=far),
        lost,
    )


def expected_errors(deviation: Array, parents: Sequence[int], unknown: Sequence[int] = ()) -> Array:
    """Return the expected error of every frame, metres, shape (F,): the mean of deviations (F, P) over the joints.

    A part's tip is a joint if another part begins there. The ends of limbs are left out: the rotation of a hand or foot
    is so much less certain than its position that they would outweigh all else. Unknown parts are left out as well.
    """
    return np.asarray(deviation[:, joint_parts(parents, unknown)].mean(axis=1))


def joint_parts(parents: Sequence[int], unknown: Sequence[int] = ()) -> list[int]:
    """Return the parts at whose tips others begin, without unknown ones; part 0 if there are none."""
    return sorted({parent for parent in parents if parent >= 0} - set(unknown)) or [0]
