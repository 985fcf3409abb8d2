"""Measuring motions against the footage: poses at the instants when views were taken, and the evidence there."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from ....body.kinematics import Poses, scene_poses
from ....body.motion import Motion
from ....body.time_shift import Delayed, delayed
from ....evidence.frame_comparison import EvidenceCaches, SegmentInViews
from ....evidence.occlusion import unseen
from ....evidence.rendering.part_geometry import PerformerParts
from ....evidence.sampling import Sampling
from ....evidence.segment_evidence import SegmentEvidence, accumulate_evidence
from ....evidence.view_work import IN_THIS_THREAD, ViewWork
from ....numerics.arrays import Array
from ....numerics.banded_blocks import BandedBlocks
from ....runtime.processes.freed_memory import return_freed_memory
from ....runtime.progress import step_share
from .problem import SegmentProblem, SegmentSolution

CACHED_EVALUATIONS = 4
"""Number of evaluations that are kept: the end of a descent is still among them when the next descent starts there,
even if later steps were evaluated and refused."""
MAX_EVIDENCE_BYTES = 160 << 20
"""Largest size of their normal equations, bytes: two evaluations of 1,000 frames from four views, as a descent holds
anyway."""
LONG = 200
"""Number of frames from which memory is given back before and after an evaluation: solving takes 0.6 MB for each."""
StepCallback = Callable[[float, Sequence[Motion]], None]
"""Called before each step with the share of the work done, 0 to 1, and the motions, and between steps without motions;
may raise to cancel the job."""


@dataclass(frozen=True, eq=False)
class Instants:
    """Views that were taken at the same F instants, and the poses of the performers at these.

    Attributes
    ----------
    views : tuple of int
        Indices of the views.
    delay : float
        How much later than the frames the instants are, in frames; interlaced fields and views with an offset lie
        between frames.
    poses : tuple of ndarray, shape (F, P, 3, 3) and (F, P, 3)
        World poses of all performers' parts.
    motions : tuple of Motion
        Per performer: the poses at the instants.
    delayed : tuple of Delayed, optional
        Per performer: how the poses at the instants depend on those on the frames. None where the instants are the
        frames.
    """

    views: tuple[int, ...]
    delay: float
    poses: Poses
    motions: tuple[Motion, ...]
    delayed: tuple[Delayed, ...] | None = None

    def on_frames(self, performer: int, blocks: BandedBlocks) -> BandedBlocks:
        """Convert a performer's normal equations for the poses at the instants to the poses on the frames."""
        return blocks if self.delayed is None else self.delayed[performer].spread(blocks)


@dataclass(frozen=True, eq=False)
class MeasuredMotion:
    """Motions of all performers, and the evidence of the images at them.

    Attributes
    ----------
    motions : tuple of Motion
        F poses per performer.
    instants : tuple of Instants
        The views, grouped by their instants.
    evidence : SegmentEvidence
    """

    motions: tuple[Motion, ...]
    instants: tuple[Instants, ...]
    evidence: SegmentEvidence


class RecentEvidence:
    """The evidence of the last evaluations: a descent that starts where another one ended need not measure it again."""

    def __init__(self) -> None:
        self._kept: deque[tuple[tuple[object, ...], list[Array | None], SegmentEvidence]] = deque()

    def evidence(self, of: tuple[object, ...], arrays: list[Array | None]) -> SegmentEvidence | None:
        """Return the evidence that was measured with the same objects and equal arrays; None if it is not kept."""
        for known, values, evidence in self._kept:
            if known == of and all(_same(a, b) for a, b in zip(values, arrays, strict=True)):
                return replace(evidence, seconds=dict.fromkeys(evidence.seconds, 0.0))
        return None

    def keep(self, of: tuple[object, ...], arrays: list[Array | None], evidence: SegmentEvidence) -> None:
        """Keep evidence; the oldest goes where there are too many (`CACHED_EVALUATIONS`), or where they take too much
        memory (`MAX_EVIDENCE_BYTES`).
        """
        self._kept.append((of, arrays, evidence))
        self._forget(CACHED_EVALUATIONS, MAX_EVIDENCE_BYTES)

    def make_room(self) -> None:
        """Forget what would have to go once another evaluation as large as the last is kept."""
        if self._kept:
            self._forget(CACHED_EVALUATIONS - 1, MAX_EVIDENCE_BYTES - self._kept[-1][2].gradients.H.nbytes)

    def forget(self) -> None:
        """Forget all evaluations."""
        self._kept.clear()

    def _forget(self, most: int, nbytes: int) -> None:
        while len(self._kept) > most or self._nbytes() > nbytes:
            self._kept.popleft()

    def _nbytes(self) -> int:
        return sum(evidence.gradients.H.nbytes for _, _, evidence in self._kept)


def _same(values: Array | None, others: Array | None) -> bool:
    return values is others if values is None or others is None else np.array_equal(values, others)


@dataclass(frozen=True, eq=False)
class Workspace:
    """Who works on the views, caches and the progress callback of a solver; none of them changes a solution.

    Attributes
    ----------
    by : ViewWork
    caches : EvidenceCaches
        Images, and drawn bodies compared with them, kept from one evaluation to the next.
    recent : RecentEvidence
        Whole evaluations.
    on_step : callable, optional
        See `StepCallback`.
    """

    by: ViewWork = IN_THIS_THREAD
    caches: EvidenceCaches = field(default_factory=EvidenceCaches)
    recent: RecentEvidence = field(default_factory=RecentEvidence)
    on_step: StepCallback | None = None

    def report(self, done: float, motions: Sequence[Motion] = ()) -> None:
        """Report the share of the work that is done, 0 to 1, and the motions before an iteration, if one begins."""
        if self.on_step is not None:
            self.on_step(done, motions)

    def part(self, begin: float, end: float) -> Workspace:
        """Return a workspace for a part of the work, whose progress runs from `begin` to `end`, 0 to 1."""
        return replace(self, on_step=step_share(self.on_step, begin, end))

    def silent(self) -> Workspace:
        """Return a workspace that does not report progress."""
        return replace(self, on_step=None)

    def measure(
        self, problem: SegmentProblem, motions: Sequence[Motion], sampling: Sampling, noise: Array | None = None
    ) -> MeasuredMotion:
        """Measure the evidence of the images at motions, F poses per performer; see `accumulate_evidence` for
        `sampling` and `noise`.
        """
        instants = view_instants(problem, motions)
        poses = poses_by_delay(problem, instants)
        parts = PerformerParts(problem.geometry(), None if problem.only is None else (problem.only,))
        asked = tuple(problem.views), problem.first, parts, sampling
        values = [noise, *(array for each in poses.values() for array in each)]
        evidence = self.recent.evidence(asked, values)
        if evidence is None:
            if problem.length >= LONG:
                self.recent.make_room()
                return_freed_memory()
            evidence = accumulate_evidence(
                SegmentInViews(problem.views, problem.first, poses, sampling),
                parts,
                noise=noise,
                caches=self.caches,
                by=self.by,
            )
            self.recent.keep(asked, values, evidence)
            if problem.length >= LONG:
                return_freed_memory()
        return MeasuredMotion(tuple(motions), instants, evidence)


def view_instants(problem: SegmentProblem, motions: Sequence[Motion]) -> tuple[Instants, ...]:
    """Group the views by the instants at which they were taken."""
    delays = [view.delay for view in problem.views]
    by_delay = {delay: tuple(v for v, own in enumerate(delays) if own == delay) for delay in dict.fromkeys(delays)}
    return tuple(
        _instants(problem, motions, views, delay - problem.footage_offset) for delay, views in by_delay.items()
    )


def measured_at(problem: SegmentProblem, solution: SegmentSolution) -> MeasuredMotion:
    """Return the measurement at a solution that carries its evidence, without evaluating the images again."""
    assert solution.evidence is not None
    return MeasuredMotion(solution.motions, view_instants(problem, solution.motions), solution.evidence)


def solution_at(
    problem: SegmentProblem,
    motions: Sequence[Motion],
    sampling: Sampling,
    workspace: Workspace,
    noise: Array | None = None,
) -> SegmentSolution:
    """Return motions as a solution that carries the evidence of the images there, without solving anything; see
    `Workspace.measure`.
    """
    evidence = workspace.measure(problem, motions, sampling, noise).evidence
    return SegmentSolution.of(motions, evidence, iterations=0, energy=(), only=problem.only)


def keypoint_instants(problem: SegmentProblem, motions: Sequence[Motion]) -> Instants:
    """Return the instants of footage without a delay of its own, at which keypoints are given."""
    return _instants(problem, motions, (), -problem.footage_offset)


def _instants(problem: SegmentProblem, motions: Sequence[Motion], views: tuple[int, ...], delay: float) -> Instants:
    if delay == 0:
        return Instants(views, delay, scene_poses(problem.bodies, motions), tuple(motions))
    there = tuple(
        delayed(motion, delay, *problem.around(i), problem.known_steps(i)) for i, motion in enumerate(motions)
    )
    shown = tuple(d.motion for d in there)
    return Instants(views, delay, scene_poses(problem.bodies, shown), shown, there)


def poses_by_delay(problem: SegmentProblem, instants: Sequence[Instants]) -> dict[float, Poses]:
    """Return the world poses of all parts by the delay of the views that show them."""
    return {problem.views[group.views[0]].delay: group.poses for group in instants}


def hidden_parts(problem: SegmentProblem, share: Array, predicted: Array | None = None) -> list[NDArray[np.bool_]]:
    """Return, per performer, which parts no view sees, (F, P); parts that a key pose fixes are never hidden.

    Parameters
    ----------
    problem : SegmentProblem
    share : ndarray, shape (V, F, P)
        Visible share of the area of every part.
    predicted : ndarray, shape (V, F, P), optional
        The same in predicted poses, see `unseen`.
    """
    keyed = [problem.fixed_axes(i).all(axis=2) for i in range(len(problem.bodies))]
    return [
        unseen(share[..., span], None if predicted is None else predicted[..., span]) & ~known
        for span, known in zip(problem.spans(), keyed, strict=True)
    ]


def keypoint_agreement(problem: SegmentProblem, motions: Sequence[Motion]) -> float:
    """Mean agreement of the keypoints with motions, 0 to 1, over the performers that are solved for."""
    R, T = keypoint_instants(problem, motions).poses
    spans = problem.spans()
    return float(np.mean([problem.keypoints[i].agreement((R[:, spans[i]], T[:, spans[i]])) for i in problem.sought]))
