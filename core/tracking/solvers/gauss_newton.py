"""Gauss-Newton over a whole segment: all of its poses are unknown at the same time.

The energy is a negative log likelihood. Residuals of brightness constancy (paper 1, equation (12)) have a standard
deviation per view, estimated robustly from the residuals themselves, and neighbouring pixels are correlated. The
accelerations of joints and root are normally distributed, with variances of human motion. Image gradients couple the
poses of neighbouring frames, and accelerations those of three frames in a row, so the normal matrix is
block-pentadiagonal and is solved by a banded Cholesky factorisation. Degrees of freedom that a key pose fixes are not
among the unknowns, so key poses are met exactly.
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
"""Metres. While steps still move some joint by more than this, a fast limb has not arrived: a tested stage goes on
beyond its iterations, and a refinement is repeated."""
LONGER = 6
"""Most iterations by which a tested stage goes on."""
AGAIN = 3
"""Most repetitions of a refinement."""
SMALL_GAIN = 1e-6
"""Relative decrease of the cost below which a stage ends."""
OVERRELAXATION = 1.5
"""Factor by which every step of a stage but the last is lengthened, where all views are evaluated. Robust weights, and
gradients measured away from the solution, make all steps too short by about the same factor."""
ROUNDS = 2
"""How often the smoothness is estimated between two evaluations of the images."""
DAMPING = Damping(initial=0.0, grow=1e4, most=1.0)
"""Steps are damped only after one was refused: smoothness makes the diagonal of the normal matrix so large that even a
small share of it would suppress slow corrections over many frames."""


@dataclass(frozen=True, eq=False)
class SegmentNoise:
    """The noise of the images, estimated at certain motions. Only costs under the same noise can be compared.

    Attributes
    ----------
    deviation : ndarray, shape (V, F - 1, 1 + P)
        Standard deviation of the grey-level residuals of each pair of frames, and of each of its parts, 0 to 1.
    weight : ndarray, shape (V, F - 1)
        Weight of the mean squared residual of each pair in the cost.
    share : ndarray, shape (V,)
        Number of independent observations that a pixel of full-resolution footage stands for, whatever the stride; see
        `SegmentEvidence.pixel_share`.
    """

    deviation: Array
    weight: Array
    share: Array

    @classmethod
    def of(cls, evidence: SegmentEvidence, settings: Settings) -> SegmentNoise:
        """Estimate the noise from evidence."""
        sums = evidence.gradients
        weight = pixel_precision(evidence, settings) * sums.count
        return cls(sums.noise, weight, evidence.pixel_share(settings.lengths[0]) / evidence.sampling.stride**2)


@dataclass(frozen=True, eq=False)
class MeasuredEquations(IndependentEquations):
    """The normal equations of all performers, and the measurement that they were built from."""

    measured: MeasuredMotion


class _TestedStage:
    """A stage in which every step is evaluated in all views and refused if it raises the cost.

    So that costs can be compared, everything else stays as it was at the start: the noise, the accelerations predicted
    for hidden parts, the plants of the feet, and the smoothness.
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
        """Measure the evidence at motions and build the normal equations."""
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
        """Root mean square of the step between two motions, radians and metres.

        It is 0, which ends the stage, if no joint has moved by more than `DescentStage.still` or, once the stage's
        iterations are over, by more than `UNDER_WAY`.
        """
        over = self.trials >= self._stage.iterations
        if farthest_joint(self._problem, before, after) < (UNDER_WAY if over else self._stage.still):
            return 0.0
        return _size([before[i].difference(after[i]) for i in self._problem.sought])

    def _moved(self, motions: tuple[Motion, ...], steps: Sequence[Array]) -> tuple[Motion, ...]:
        assert self._tied is not None
        return moved_by(motions, increments_of(self._tied, steps, self._pace))


def refine(
    problem: SegmentProblem,
    start: Sequence[Motion],
    workspace: Workspace,
    stages: Sequence[DescentStage] = REFINEMENT,
) -> SegmentSolution:
    """Refine a solution once the motion on both sides of the segment is known.

    A descent keeps the noise and the smoothness of its start. If it moves some joint by more than `UNDER_WAY`, they no
    longer fit, and it is repeated, up to `AGAIN` times. Parameters as in `descend`.
    """
    share = 1 / (1 + AGAIN)
    found = descend(problem, start, workspace.part(0.0, share), stages)
    seconds = Seconds(found.seconds)
    moved = farthest_joint(problem, start, found.motions)
    for again in range(1, 1 + AGAIN):
        if moved < UNDER_WAY:
            break
        further = descend(problem, found.motions, workspace.part(again * share, (again + 1) * share), stages)
        moved = farthest_joint(problem, found.motions, further.motions)
        seconds.add(further.seconds)
        found = continued(found, further)
    return replace(found, seconds=seconds)


def continued(before: SegmentSolution, after: SegmentSolution) -> SegmentSolution:
    """Return the second of two solutions, of which the first was its start, with the iterations of both."""
    return replace(after, iterations=before.iterations + after.iterations, energy=(*before.energy, *after.energy))


def farthest_joint(problem: SegmentProblem, before: Sequence[Motion], after: Sequence[Motion]) -> float:
    """Largest distance between the positions of a joint in two motions, over all frames and the performers that are
    solved for, metres.
    """
    joints = [[part_poses(problem.bodies[i], m[i])[1] for m in (before, after)] for i in problem.sought]
    return max(float(np.linalg.norm(b - a, axis=-1).max()) for a, b in joints)


def descend(
    problem: SegmentProblem,
    start: Sequence[Motion],
    workspace: Workspace,
    stages: Sequence[DescentStage] = STAGES,
    noise: SegmentNoise | None = None,
) -> SegmentSolution:
    """Descend from a start to the nearest minimum, in stages from coarse to fine images.

    Steps of the last stage are refused where they raise the cost; those of the others are not tested, see `approach`.
    Everything in the solution was measured at the motions that are returned.

    Parameters
    ----------
    problem : SegmentProblem
    start : sequence of Motion
        F poses per performer; fixed degrees of freedom keep these values.
    workspace : Workspace
        Progress is reported before each iteration.
    stages : sequence of DescentStage
    noise : SegmentNoise, optional
        Noise under which the costs of the last stage are computed; by default it is estimated at the start of that
        stage.
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
    """Descend by steps that are not tested.

    Coarse stages evaluate a different subset of the views at every iteration, so the costs of two iterations cannot be
    compared. Parameters as in `descend`.

    Returns
    -------
    motions : tuple of Motion
    energies : list of float
        Cost before each iteration.
    seconds : Seconds
    smooth : SegmentSmoothness
        The last estimate.
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
    """Turn the steps of tied systems, times a pace, into increments (F, D) by performer.

    They are bounded in length (`core.body.smoothness.limited`), and rounded so that all processors give the same bits.
    """
    return {i: on_grid(limited(pace * step)) for i, step in tied.by_performer(steps).items()}


def moved_by(motions: Sequence[Motion], increments: Mapping[int, Array]) -> tuple[Motion, ...]:
    """Return the motions of all performers, moved where there are increments."""
    return tuple(m.moved(increments[i]) if i in increments else m for i, m in enumerate(motions))


def _size(steps: Sequence[Array]) -> float:
    """Root mean square of all elements of steps."""
    return float(np.sqrt(np.mean(np.concatenate([step.ravel() for step in steps]) ** 2)))


def view_subset(problem: SegmentProblem, least: int, turn: int) -> SegmentProblem:
    """Return the problem with every k-th view, so that at least `least` remain; each turn takes the next subset."""
    every = max(1, len(problem.views) // least)
    return replace(problem, views=problem.views[turn % every :: every])


def with_priors(
    problem: SegmentProblem,
    motions: Sequence[Motion],
    images: Sequence[BandedBlocks],
    smooth: SegmentSmoothness,
    expected: Sequence[Array] = (),
) -> list[BandedBlocks]:
    """Add the priors to the normal equations of the evidence: smoothness, and stiff parts near the key poses' curve.

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
        systems[i] = images[i] + smooth.blocks(problem, i, motions[i], expected[i] if expected else None)
    return with_curves(problem, systems, tuple(motions))


def equations_at(problem: SegmentProblem, solution: SegmentSolution) -> list[BandedBlocks]:
    """Return the normal equations of every performer at a solution that carries its evidence, without those of plants
    and holds.
    """
    motions, measured = solution.motions, measured_at(problem, solution)
    hidden, expected = hidden_and_expected(problem, motions, measured.evidence)
    images = evidence_equations(problem, measured, hidden)
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
    return hidden, predicted_accelerations(motions, hidden, problem.sought)


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
    evidence = measured.evidence.without(np.concatenate(hidden, axis=1)) if hidden else measured.evidence
    precision = pixel_precision(evidence, problem.settings)
    tolerance = evidence.sampling.tolerance
    # Far from the solution the search lines are long and meet outlines of other limbs: outlines then weigh little.
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
    """Normal equations of gradients and outlines, by performer that is solved for: of views with the same instants."""
    (R, T), views, (precision, outlines) = instants.poses, list(instants.views), weights
    pairs, frames = evidence.gradients, evidence.outlines
    H = np.einsum("vf,vfpij->fpij", precision[views], pairs.H[views])
    g = np.einsum("vf,vfpi->fpi", precision[views], pairs.g[views])
    outline_H, outline_g = (outlines * a[views].sum(axis=0) for a in (frames.H, frames.g))
    # Outlines belong to single frames: each is added to the pair that its frame begins, the last to the pair it ends.
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
    """Return, per performer, the accelerations (F, D) of hidden parts in the motion that is predicted for them.

    They are zero for parts that are seen, and for performers that are not solved for.
    """
    expected = []
    for i, (motion, mask) in enumerate(zip(motions, hidden, strict=True)):
        predicted = np.zeros((len(motion), 3 + 3 * mask.shape[1]))
        if i in sought and mask.any() and len(motion) > 2:
            predicted[1:-1] = acceleration(predict_unseen(motion, mask))
        degrees = np.concatenate([np.repeat(mask[:, :1], 3, axis=1), np.repeat(mask, 3, axis=1)], axis=1)
        expected.append(predicted * degrees)
    return expected


def pixel_precision(evidence: SegmentEvidence, settings: Settings) -> Array:
    """Inverse variance of a pixel's residual, less the correlation of neighbouring pixels, shape (V, F - 1).

    The noise is that of the view, or where parts have a noise of their own, that of each pair of frames.
    """
    noise = evidence.gradients.noise[..., 0]
    if not evidence.sampling.by_part:
        noise = np.broadcast_to(np.median(noise, axis=1, keepdims=True), noise.shape)
    return np.asarray(evidence.pixel_share(settings.lengths[0])[:, None] / np.maximum(noise, 1e-3) ** 2)
