"""Gauss-Newton over a whole segment: all its poses are unknown at once.

The energy is that of a model of the errors: residuals of brightness constancy have a robust standard deviation per
view, found from themselves, and neighbouring pixels repeat one another; accelerations of joints and of the root have
the spread of human motion. Gradients couple neighbouring frames and smoothness the next but one, so the normal matrix
is block-pentadiagonal and solved by a banded Cholesky factorisation; key poses are met exactly, as their degrees of
freedom are not among the unknowns.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ...body import part_poses
from ...body.joint_blocks import joint_blocks
from ...body.motion import Motion
from ...body.smoothness import acceleration, limited
from ...evidence.accumulate import SegmentEvidence
from ...numerics.arrays import Array
from ...numerics.banded_blocks import BandedBlocks
from ...numerics.least_squares import Damping, LeastSquaresResult, StoppingRule, minimise
from ...numerics.normal_equations import IndependentEquations
from ...numerics.repeatable import on_grid
from ...runtime.timing import Seconds
from ...shot.shot import Settings
from ..prediction import predict_unseen
from .contact_factor import with_contact
from .curve_factor import with_curves
from .descent_stages import REFINEMENT, STAGES, DescentStage
from .hold_factor import TiedSystems
from .measurement import Instants, MeasuredMotion, Workspace, hidden_parts, keypoint_instants, measured_at
from .plant_factor import PlantFactor, plants_of, with_plants
from .problem import SegmentProblem, SegmentSolution
from .smoothness_factor import SegmentSmoothness

UNDER_WAY = 0.02
"""While a step moves any joint by more than this, metres, a tested stage goes on beyond its iterations: a fast limb is
still on its way."""
LONGER = 6
"""By so many iterations at most."""
AGAIN = 3
"""How often a refinement that has moved a joint by as much is repeated, at most."""
SMALL_GAIN = 1e-6
"""Share of the cost that a step should gain at least to be followed by another."""
OVERRELAXATION = 1.5
"""All steps of a stage but its last are taken this much longer, where all views are looked at: weights that follow the
residuals, and slopes measured beside the solution, make every step too short by about the same share."""
ROUNDS = 2
"""How often smoothness is estimated after each look at the pictures: these are looked at again."""
DAMPING = Damping(initial=0.0, grow=1e4, most=1.0)
"""None but where a step was refused: smoothness makes the diagonal so large that the least share of it stops slow, wide
corrections."""


@dataclass(frozen=True, eq=False)
class SegmentNoise:
    """The noise of the images as it was measured at some motions; costs under the same noise can be compared.

    Attributes
    ----------
    deviation : ndarray, shape (V, F - 1)
        Standard deviation of the residuals of each pair of frames, grey level 0 to 1.
    weight : ndarray, shape (V, F - 1)
        What the mean error of each pair's pixels counts.
    share : ndarray, shape (V,)
        What a pixel of the frames counts, however many of them are looked at; see `SegmentEvidence.pixel_share`.
    """

    deviation: Array
    weight: Array
    share: Array

    @classmethod
    def of(cls, evidence: SegmentEvidence, settings: Settings) -> SegmentNoise:
        """The noise at the motions whose evidence this is."""
        sums = evidence.gradients
        weight = view_precision(evidence, settings)[:, None] * sums.count
        return cls(sums.noise, weight, evidence.pixel_share(settings.lengths[0]) / evidence.sampling.stride**2)


@dataclass(frozen=True, eq=False)
class MeasuredEquations(IndependentEquations):
    """The performers' normal equations with what was measured for them.

    Attributes
    ----------
    measured : MeasuredMotion
    """

    measured: MeasuredMotion


class _TestedStage:
    """A stage at whose steps all views are looked at, and each step is tested.

    The noise under which costs are compared, what is expected of parts that are out of sight, the plants, and the
    smoothness, if it is estimated, are those of the start; they stay while steps are tested.
    """

    def __init__(
        self,
        problem: SegmentProblem,
        stage: DescentStage,
        workspace: Workspace,
        smooth: SegmentSmoothness,
        noise: SegmentNoise | None,
    ) -> None:
        self.smooth = smooth
        self.seconds, self.trials = Seconds(), 0
        self._problem, self._stage, self._workspace, self._noise = problem, stage, workspace, noise
        self._hidden: list[NDArray[np.bool_]] | None = None
        self._expected: list[Array] = []
        self._plants: list[PlantFactor | None] = [None] * len(problem.bodies)
        self._tied: TiedSystems | None = None
        self._pace = OVERRELAXATION

    def minimise(self, start: tuple[Motion, ...]) -> LeastSquaresResult[tuple[Motion, ...], MeasuredEquations]:
        """Descend from the start."""
        stage = self._stage
        stopping = StoppingRule(
            stage.iterations + LONGER,
            SMALL_GAIN,
            stage.small,
            self._distance,
            small_refused=stage.small_refused,
            # A step's gain is the square of its length in standard deviations.
            least_promise=stage.noticed**2
            * sum(np.count_nonzero(~self._problem.fixed[i]) for i in self._problem.sought),
        )
        return minimise(
            start, self._linearise, self._moved, damping=DAMPING, stopping=stopping, on_iteration=self._begin_step
        )

    def _linearise(self, motions: tuple[Motion, ...]) -> MeasuredEquations:
        """The normal equations at motions."""
        problem, sampling = self._problem, self._stage.sampling_of(len(self._problem.views))
        deviation = None if self._noise is None else self._noise.deviation
        measured = self._workspace.measure(problem, motions, sampling, deviation)
        evidence = measured.evidence
        self.seconds.add(evidence.seconds)
        with self.seconds.measure("solve"):
            if self._noise is None:
                self._noise = SegmentNoise.of(evidence, problem.settings)
            begins = self._hidden is None
            if self._hidden is None:
                self._hidden, self._expected = hidden_and_expected(problem, motions, evidence)
                if self._stage.plants or not problem.shows_depth:
                    self._plants = plants_of(problem, motions)
            images = evidence_equations(problem, measured, self._hidden, self._noise)
            if begins:
                self.smooth = self.smooth.estimated(problem, motions, images, self._expected, rounds=ROUNDS)
            systems = with_priors(problem, motions, images, self.smooth, self._expected)
            systems = with_plants(systems, self._plants, problem.bodies, motions)
            systems = with_contact(systems, problem.contact, problem.bodies, motions, problem.sought)
            self._tied = problem.tied(systems, motions)
            return MeasuredEquations(self._tied.systems, measured)

    def _begin_step(self, done: int, motions: tuple[Motion, ...]) -> None:
        self.trials += 1
        self._pace = OVERRELAXATION if done + 1 < self._stage.iterations else 1.0
        self._workspace.report(min(done / self._stage.iterations, 1.0), motions)

    def _distance(self, before: tuple[Motion, ...], after: tuple[Motion, ...]) -> float:
        """Root mean square of the step from some motions to others; none where all joints are still or, once the
        stage's iterations are over, none is under way.
        """
        over = self.trials >= self._stage.iterations
        if farthest_joint(self._problem, before, after) < (UNDER_WAY if over else self._stage.still):
            return 0.0
        return _size([before[i].difference(after[i]) for i in self._problem.sought])

    def _moved(self, motions: tuple[Motion, ...], steps: Sequence[Array]) -> tuple[Motion, ...]:
        assert self._tied is not None
        return moved_by(motions, increments_of(self._tied, steps, self._pace))


def refine(problem: SegmentProblem, start: Sequence[Motion], workspace: Workspace) -> SegmentSolution:
    """Continue from a solution when more is known of the motion around the segment.

    The noise and the smoothness are those of the start: where they led far from it, what is found is no
    solution yet with those that are found there.
    """
    share = 1 / (1 + AGAIN)
    found = descend(problem, start, workspace.part(0.0, share), REFINEMENT)
    seconds = Seconds(found.seconds)
    moved = farthest_joint(problem, start, found.motions)
    for again in range(1, 1 + AGAIN):
        if moved < UNDER_WAY:
            break
        further = descend(problem, found.motions, workspace.part(again * share, (again + 1) * share), REFINEMENT)
        moved = farthest_joint(problem, found.motions, further.motions)
        seconds.add(further.seconds)
        found = continued(found, further)
    return replace(found, seconds=seconds)


def continued(before: SegmentSolution, after: SegmentSolution) -> SegmentSolution:
    """A solution that another one led to, with the iterations of both."""
    return replace(after, iterations=before.iterations + after.iterations, energy=(*before.energy, *after.energy))


def farthest_joint(problem: SegmentProblem, before: Sequence[Motion], after: Sequence[Motion]) -> float:
    """How far the joint that moves most is between some motions and others, metres, of the performers sought."""
    joints = [[part_poses(problem.bodies[i], m[i])[1] for m in (before, after)] for i in problem.sought]
    return max(float(np.linalg.norm(b - a, axis=-1).max()) for a, b in joints)


def descend(
    problem: SegmentProblem,
    start: Sequence[Motion],
    workspace: Workspace,
    stages: Sequence[DescentStage] = STAGES,
    noise: SegmentNoise | None = None,
) -> SegmentSolution:
    """Descend from a start to the nearest solution.

    Every step of the last stage is tested. All that is returned was measured at the motions that are returned.

    Parameters
    ----------
    problem : SegmentProblem
    start : sequence of Motion
        F poses per performer; their fixed degrees of freedom are kept.
    workspace : Workspace
        Progress is reported before each iteration.
    stages : sequence of DescentStage
    noise : SegmentNoise, optional
        The noise under which the last stage's costs are measured; by default that at its start.
    """
    *coarse, last = stages
    share = 1 - last.iterations / sum(stage.iterations for stage in stages)
    start, energies, seconds, smooth = approach(problem, start, workspace.part(0.0, share), coarse)
    stage = _TestedStage(problem, last, workspace.part(share, 1.0), smooth, noise)
    result = stage.minimise(start)
    with stage.seconds.measure("solve"):
        equations = result.linearised()
    seconds.add(stage.seconds)
    return SegmentSolution.of(
        result.state,
        equations.measured.evidence,
        iterations=len(energies) + stage.trials,
        energy=(*energies, *result.cost_history),
        seconds=seconds,
        variances=stage.smooth.variances,
        only=problem.only,
    )


def approach(
    problem: SegmentProblem, start: Sequence[Motion], workspace: Workspace, stages: Sequence[DescentStage]
) -> tuple[tuple[Motion, ...], list[float], Seconds, SegmentSmoothness]:
    """Descend by steps that are not tested: coarse stages look at other views every time, whose costs differ.

    Returns
    -------
    motions : tuple of Motion
    energies : list of float
        Before each iteration.
    seconds : Seconds
    smooth : SegmentSmoothness
        As it was estimated at last.
    """
    motions, seconds, smooth = tuple(start), Seconds(), SegmentSmoothness.start(problem)
    energies: list[float] = []
    planned = sum(stage.iterations for stage in stages)
    for s, stage in enumerate(stages):
        before = sum(earlier.iterations for earlier in stages[:s])
        hidden: list[NDArray[np.bool_]] = []
        expected: list[Array] = []
        for i in range(stage.iterations):
            workspace.report((before + i) / planned, motions)
            seen = problem if stage.views is None else view_subset(problem, stage.views, i)
            measured = workspace.measure(seen, motions, stage.sampling_of(len(seen.views)))
            seconds.add(measured.evidence.seconds)
            longer = i + 1 < stage.iterations and len(seen.views) == len(problem.views)
            pace = OVERRELAXATION if longer else 1.0
            with seconds.measure("solve"):
                if not hidden:
                    hidden, expected = hidden_and_expected(seen, motions, measured.evidence)
                images = evidence_equations(seen, measured, hidden)
                smooth = smooth.estimated(seen, motions, images, expected, rounds=ROUNDS, bursts=False)
                systems = with_priors(seen, motions, images, smooth, expected)
                tied = seen.tied(systems, motions)
                steps = increments_of(tied, [system.solve(0.0) for system in tied.systems], pace)
                motions = moved_by(motions, steps)
                energies.append(tied.cost)
            if _size(list(steps.values())) < stage.small:
                break
    return motions, energies, seconds, smooth


def increments_of(tied: TiedSystems, steps: Sequence[Array], pace: float = 1.0) -> dict[int, Array]:
    """The increments (F, D) of each performer that the steps of tied systems, times a pace, lead to: of bounded length,
    and the same on every processor.
    """
    return {i: on_grid(limited(pace * step)) for i, step in tied.by_performer(steps).items()}


def moved_by(motions: Sequence[Motion], increments: Mapping[int, Array]) -> tuple[Motion, ...]:
    """The motions of all performers, those with increments moved."""
    return tuple(m.moved(increments[i]) if i in increments else m for i, m in enumerate(motions))


def _size(steps: Sequence[Array]) -> float:
    """Root mean square of steps."""
    return float(np.sqrt(np.mean(np.concatenate([step.ravel() for step in steps]) ** 2)))


def view_subset(problem: SegmentProblem, least: int, turn: int) -> SegmentProblem:
    """The problem with every k-th view alone, beginning elsewhere with every turn, so that `least` are left."""
    every = max(1, len(problem.views) // least)
    return replace(problem, views=problem.views[turn % every :: every])


def with_priors(
    problem: SegmentProblem,
    motions: Sequence[Motion],
    images: Sequence[BandedBlocks],
    smooth: SegmentSmoothness,
    expected: Sequence[Array] = (),
) -> list[BandedBlocks]:
    """The normal equations of the evidence, of smoothness, and of stiff parts that leave the curve of the key poses.

    Parameters
    ----------
    problem : SegmentProblem
    motions : sequence of Motion
    images : sequence of BandedBlocks
        Per performer: the evidence at these motions.
    smooth : SegmentSmoothness
    expected : sequence of ndarray, shape (F, D)
        Per performer: accelerations that cost nothing; by default none.
    """
    systems = list(images)
    for i in problem.sought:
        systems[i] = images[i] + smooth.blocks(problem, i, motions[i], expected[i] if expected else None)
    return with_curves(problem, systems, tuple(motions))


def equations_at(problem: SegmentProblem, solution: SegmentSolution) -> list[BandedBlocks]:
    """The normal equations of every performer at a solution, which has its evidence, but for plants and holds."""
    motions, measured = solution.motions, measured_at(problem, solution)
    hidden, expected = hidden_and_expected(problem, motions, measured.evidence)
    images = evidence_equations(problem, measured, hidden)
    systems = with_priors(problem, motions, images, SegmentSmoothness(solution.variances), expected)
    return with_contact(systems, problem.contact, problem.bodies, motions, problem.sought)


def hidden_and_expected(
    problem: SegmentProblem, motions: Sequence[Motion], evidence: SegmentEvidence
) -> tuple[list[NDArray[np.bool_]], list[Array]]:
    """Per performer, the parts that no view shows and the accelerations predicted for them, see `hidden_parts` and
    `predicted_accelerations`; nothing where the motion of unseen parts is not predicted.
    """
    if not problem.settings.prediction:
        return [], []
    hidden = hidden_parts(problem, evidence.share)
    return hidden, predicted_accelerations(motions, hidden, problem.sought)


def evidence_equations(
    problem: SegmentProblem,
    measured: MeasuredMotion,
    hidden: Sequence[NDArray[np.bool_]] = (),
    noise: SegmentNoise | None = None,
) -> list[BandedBlocks]:
    """The normal equations of every performer without smoothness: gradients and outlines of all views, and keypoints.

    Those of a performer that is not sought are zero: its motion is given.

    Parameters
    ----------
    problem : SegmentProblem
    measured : MeasuredMotion
        The motions, with the evidence there.
    hidden : sequence of ndarray of bool, shape (F, P)
        Per performer: the parts whose pixels are left out.
    noise : SegmentNoise, optional
        The noise under which the cost of the gradients is measured; by default that at the motions.
    """
    noise = noise or SegmentNoise.of(measured.evidence, problem.settings)
    evidence = measured.evidence.without(np.concatenate(hidden, axis=1)) if hidden else measured.evidence
    precision = view_precision(evidence, problem.settings)
    tolerance = evidence.sampling.tolerance
    # Lines that reach farther than the error find other limbs' outlines: far from the solution they count for little.
    outlines = 1 / (problem.settings.lengths[1] * tolerance**2)
    systems = [BandedBlocks.zeros(problem.length, body.dof) for body in problem.bodies]
    for instants in measured.instants:
        for i, own in _image_systems(problem, instants, evidence, (precision, outlines), noise).items():
            systems[i] += own
    if problem.keypoints:
        instants = keypoint_instants(problem, measured.motions)
        R, T = instants.poses
        spans = problem.spans()
        for i in problem.sought:
            seen = problem.keypoints[i].blocks(problem.bodies[i], (R[:, spans[i]], T[:, spans[i]]), tolerance)
            systems[i] += instants.on_frames(i, seen)
    return systems


def _image_systems(
    problem: SegmentProblem,
    instants: Instants,
    evidence: SegmentEvidence,
    weights: tuple[Array, float],
    noise: SegmentNoise,
) -> dict[int, BandedBlocks]:
    """The normal equations of the performers that are sought: gradients and outlines of the views that were taken at
    some instants.
    """
    (R, T), views, (precision, outlines) = instants.poses, list(instants.views), weights
    pairs, frames = evidence.gradients, evidence.outlines
    H = np.tensordot(precision[views], pairs.H[views], 1)
    g = np.tensordot(precision[views], pairs.g[views], 1)
    outline_H, outline_g = (outlines * a[views].sum(axis=0) for a in (frames.H, frames.g))
    # The outlines of a frame are counted with the pair that it begins, those of the last with the pair that it ends.
    H[..., :6, :6] += outline_H[:-1]
    H[-1, :, 6:, 6:] += outline_H[-1]
    g[..., :6] += outline_g[:-1]
    g[-1, :, 6:] += outline_g[-1]
    energy = float(np.sum(noise.weight[views] * pairs.cost[views])) + outlines * float(frames.energy[views].sum())
    systems, spans = {}, problem.spans()
    for i in problem.sought:
        body, span = problem.bodies[i], spans[i]
        own = joint_blocks(body, (R[:, span], T[:, span]), H[:, span], g[:, span], energy / len(problem.sought))
        systems[i] = instants.on_frames(i, own)
    return systems


def predicted_accelerations(
    motions: Sequence[Motion], hidden: Sequence[NDArray[np.bool_]], sought: Sequence[int]
) -> list[Array]:
    """Accelerations that parts have, where they are hidden, in the motion predicted for them, else zero, (F, D); zero
    for performers that are not sought.
    """
    expected = []
    for i, (motion, mask) in enumerate(zip(motions, hidden, strict=True)):
        predicted = np.zeros((len(motion), 3 + 3 * mask.shape[1]))
        if i in sought and mask.any() and len(motion) > 2:
            predicted[1:-1] = acceleration(predict_unseen(motion, mask))
        degrees = np.concatenate([np.repeat(mask[:, :1], 3, axis=1), np.repeat(mask, 3, axis=1)], axis=1)
        expected.append(predicted * degrees)
    return expected


def view_precision(evidence: SegmentEvidence, settings: Settings) -> Array:
    """Inverse variance of a residual of each view, with the pixels that repeat one another counted once, shape (V,)."""
    noise = np.maximum(np.median(evidence.gradients.noise, axis=1), 1e-3)
    return np.asarray(evidence.pixel_share(settings.lengths[0]) / noise**2)
