"""Uncertainty: how far every joint may be from where the tracker has it.

The covariance of the poses is the inverse of the solver's normal matrix. Two things that the solver's model of the
errors leaves out are put in here: that outlines err alike on all frames, as the model's shape is wrong in one way, and
that a solution may be the wrong one, which shows as foreground left uncovered.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ..body import Body, part_poses
from ..body.kinematics import point_jacobian
from ..body.motion import Motion
from ..evidence.misfit import uncovered_gaps
from ..numerics.arrays import Array
from ..numerics.banded import BandedFactor
from .solvers.gauss_newton import normal_equations
from .solvers.measurement import MeasuredMotion, hidden_parts, poses_by_delay, view_instants
from .solvers.problem import SegmentProblem, SegmentSolution
from .solvers.smoothness_factor import SegmentSmoothness

ALIKE = 25.0
"""Length of outline, over the frames, that errs alike, metres: it counts as one measurement."""
DISTANT = 0.2
"""Residuals of pixels closer together than this on the body, metres, count as one measurement. It is more than in
tracking: errors that stay do not mislead the motion much, but make its place less certain."""
MISPLACED = 2.0
"""Error of a joint per gap between the outlines: what is misplaced are a few limbs, the gap is the whole outline's."""


def joint_deviations(problem: SegmentProblem, solution: SegmentSolution, threads: int = 1) -> list[Array]:
    """Expected distance of every part's tip from its true place, metres: per performer, shape (F, P).

    Where the poses are held it is zero.

    Parameters
    ----------
    problem : SegmentProblem
        As it was solved.
    solution : SegmentSolution
    threads : int
    """
    assert solution.evidence is not None
    motions = solution.motions
    measured = MeasuredMotion(motions, view_instants(problem, motions), solution.evidence)
    covariances = pose_covariances(problem, measured, SegmentSmoothness(solution.variances))
    gaps = uncovered_gaps(
        problem.views,
        problem.geometry(),
        poses_by_delay(problem, measured.instants),
        first=problem.first,
        spans=problem.spans(),
        known=[problem.whole_keys(i) for i in range(len(problem.bodies))],
        threads=threads,
    )
    deviations = []
    for i, (body, motion) in enumerate(zip(problem.bodies, motions, strict=True)):
        misplaced = MISPLACED * gaps[i] * ~problem.fixed[i].all(axis=1)
        deviations.append(np.hypot(tip_deviations(body, motion, covariances[i]), misplaced[:, None]))
    return deviations


def expected_errors(deviation: Array, parents: Sequence[int], unknown: Sequence[int] = ()) -> Array:
    """Expected error of every frame, metres, shape (F,): mean over the joints, of deviations (F, P) of all tips.

    A part's tip is a joint where another part begins. The ends of limbs are no joints: how a hand is turned, or a foot,
    is seen so much worse than where it is that they would outweigh all else. Unknown parts are left out.
    """
    return np.asarray(deviation[:, joint_parts(parents, unknown)].mean(axis=1))


def joint_parts(parents: Sequence[int], unknown: Sequence[int] = ()) -> list[int]:
    """Parts that others begin at, without unknown ones; all of them where there is one alone."""
    return sorted({parent for parent in parents if parent >= 0} - set(unknown)) or [0]


def pose_covariances(
    problem: SegmentProblem, measured: MeasuredMotion, smoothness: SegmentSmoothness | None = None
) -> list[Array]:
    """Covariances of every performer's poses, (F, D, D), in the order of the degrees of freedom; see the module."""
    settings = problem.settings
    softened = replace(settings, outline_correlation=ALIKE, correlation_length=max(DISTANT, settings.lengths[0]))
    hidden = hidden_parts(problem, measured.evidence.share) if settings.prediction else []
    systems = normal_equations(replace(problem, settings=softened), measured, hidden, (), smooth=smoothness)
    return [BandedFactor(s, fixed).covariances() for s, fixed in zip(systems, problem.fixed, strict=True)]


def tip_deviations(body: Body, motion: Motion, covariances: Array) -> Array:
    """Standard deviation of the place of every part's tip, (F, P), metres, of covariances of the poses (F, D, D)."""
    R, T = part_poses(body, motion)
    tips = np.array([[0.0, np.linalg.norm(part.tail_world - part.head_world), 0.0] for part in body.parts])
    points = np.einsum("fpab,pb->fpa", R, tips) + T
    J = point_jacobian(body, R, T, np.arange(len(body)), points)
    J_C = (J.reshape(len(J), -1, body.dof) @ covariances).reshape(J.shape)
    return np.asarray(np.sqrt(np.maximum((J * J_C).sum(axis=(2, 3)), 0)))
