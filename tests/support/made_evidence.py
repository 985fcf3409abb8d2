"""Evidence that is made by hand, or altered after it was measured, to test solvers without footage."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from kfmocap.core.body.kinematics import scene_poses
from kfmocap.core.body.motion import Motion
from kfmocap.core.evidence.gradient_evidence.gradients import GradientSums
from kfmocap.core.evidence.outline_evidence.outline_sums import OutlineSums
from kfmocap.core.evidence.sampling import Sampling
from kfmocap.core.evidence.segment_evidence import SegmentEvidence
from kfmocap.core.numerics import rotations
from kfmocap.core.tracking.solvers.equations.measurement import Instants, MeasuredMotion, Workspace
from kfmocap.core.tracking.solvers.equations.problem import SegmentProblem, SegmentSolution

Array = np.ndarray


def no_evidence(views: int, frames: int, parts: int) -> SegmentEvidence:
    """Evidence of views that show nothing."""
    V, F, P = views, frames, parts
    pairs = [np.zeros((V, F - 1, *more)) for more in ((), (), (1 + P,), (), (), (), ())]
    gradients = GradientSums(np.zeros((V, F - 1, P, 12, 12)), np.zeros((V, F - 1, P, 12)), *pairs)
    outlines = OutlineSums(np.zeros((V, F, P, 6, 6)), np.zeros((V, F, P, 6)), np.zeros((V, F)))
    explained, unhidden = np.zeros((V, 1, F)), np.ones((1, F))
    whole = np.ones((V, F, P))
    return SegmentEvidence(gradients, outlines, explained, unhidden, whole, whole, Sampling(1.0, 1.0, 1), {})


@dataclass(frozen=True, eq=False)
class AlteredWorkspace(Workspace):
    """A workspace that alters what it measures."""

    alter: Callable[[SegmentProblem, MeasuredMotion], MeasuredMotion] = field(default=lambda _, measured: measured)

    def measure(
        self, problem: SegmentProblem, motions: Sequence[Motion], sampling: Sampling, noise: Array | None = None
    ) -> MeasuredMotion:
        return self.alter(problem, super().measure(problem, motions, sampling, noise))


def with_share(share: Callable[[SegmentProblem, Array], Array]) -> AlteredWorkspace:
    """A workspace whose parts are visible as a function of the problem and the true shares says."""

    def alter(problem: SegmentProblem, measured: MeasuredMotion) -> MeasuredMotion:
        evidence = measured.evidence
        return replace(measured, evidence=replace(evidence, share=share(problem, evidence.share)))

    return AlteredWorkspace(alter=alter)


@dataclass(frozen=True, eq=False)
class Landscape(Workspace):
    """A workspace whose evidence is that of a world in which parts near to their true poses are pulled to them.

    The others are held where they are. The nearer a part's rotation, the more of it is covered.

    Attributes
    ----------
    truth : Motion
        A single performer's, from frame 0 on.
    reach : float
        Parts that are farther than this from their true rotation are not pulled, radians.
    cover : float
        Of a part that is where it should be, on every frame.
    measured : list of Motion
        Every motion that was measured.
    by_part : list of bool
        For each of these, whether parts had a noise of their own.
    """

    truth: Motion | None = None
    reach: float = 0.35
    cover: float = 1000.0
    measured: list[Motion] = field(default_factory=list)
    by_part: list[bool] = field(default_factory=list)

    def measure(
        self, problem: SegmentProblem, motions: Sequence[Motion], sampling: Sampling, noise: Array | None = None
    ) -> MeasuredMotion:
        self.measured.append(motions[0])
        self.by_part.append(sampling.by_part)
        poses = scene_poses(problem.bodies, motions)
        evidence = self._evidence(problem, poses, sampling)
        return MeasuredMotion(tuple(motions), (Instants((0,), 0.0, poses, tuple(motions)),), evidence)

    def _evidence(self, problem: SegmentProblem, poses: tuple[Array, Array], sampling: Sampling) -> SegmentEvidence:
        assert self.truth is not None
        true = self.truth[problem.first : problem.first + problem.length]
        (R, T), (R_true, T_true) = poses, scene_poses(problem.bodies, [true])
        turn = rotations.log(R_true @ np.swapaxes(R, -1, -2))
        near = np.linalg.norm(turn, axis=-1) < self.reach
        # The twist about the world's origin that takes a part to its true pose, for small turns.
        twist = np.concatenate([T_true - T - np.cross(turn, T), turn], axis=-1)
        weight = np.full(near.shape, 1e8)
        made = no_evidence(1, *near.shape)
        outlines = OutlineSums(
            (weight[..., None, None] * np.eye(6))[None],
            -((weight * near)[..., None] * twist)[None],
            (weight * np.where(near, (twist**2).sum(axis=-1), self.reach**2)).sum(axis=1)[None],
        )
        loss = np.minimum(np.linalg.norm(turn, axis=-1) / np.pi, 1)
        explained = self.cover * (1 - loss).sum(axis=1)[None, None]
        return replace(made, outlines=outlines, explained=explained, sampling=sampling)

    def solution(self, problem: SegmentProblem, motion: Motion) -> SegmentSolution:
        """A motion as if a solver had found it."""
        evidence = self._evidence(problem, scene_poses(problem.bodies, [motion]), Sampling(1.0, 1.0, 1))
        energy = float(evidence.outlines.energy.sum()) / problem.settings.lengths[1]
        return SegmentSolution.of([motion], evidence, iterations=1, energy=[energy])
