"""Gauss-Newton over a whole segment: all of its poses are unknown at the same time.

The energy is a negative log likelihood. Its normal equations (`segment_equations`) are block-pentadiagonal and are
solved by a banded Cholesky factorisation. Degrees of freedom that a key pose fixes are not among the unknowns, so key
poses are met exactly.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ...body import part_poses
from ...body.kinematics import tip_positions
from ...body.motion import Motion
from ...body.smoothness import limited
from ...evidence.segment_evidence import SegmentEvidence
from ...numerics.arrays import Array
from ...numerics.least_squares import Damping, LeastSquaresResult, StoppingRule, minimise
from ...numerics.normal_equations import IndependentEquations
from ...numerics.repeatable import on_grid
from ...runtime.timing import Seconds
from .descent_stages import REFINEMENT, STAGES, UNCONVERGED_MOVE, DescentStage
from .equations.contact_factor import with_contact
from .equations.hold_factor import TiedSystems
from .equations.measurement import MeasuredMotion, Workspace
from .equations.plant_factor import PlantFactor, plants_of, with_plants
from .equations.problem import SegmentProblem, SegmentSolution
from .equations.segment_equations import SegmentNoise, evidence_equations, hidden_and_expected, with_priors
from .equations.smoothness_factor import SegmentSmoothness
from .view_subsets import view_subset, views_in_sight

MAX_EXTRA_ITERATIONS = 6
"""Most iterations by which a tested stage goes on."""
MAX_REPEATS = 3
_STEP_SHARE, _DESCENT_SHARE = 0.4, 0.7
"""Shares that a step of a tested stage, and a descent of a refinement, take of the progress that is left: most stages
end after a few steps, and most refinements after one descent."""
"""Most repetitions of a refinement."""
SMALL_GAIN = 1e-6
"""Relative decrease of the cost below which a stage ends."""
OVERRELAXATION = 1.5
"""Factor by which every step of a stage but the last is lengthened, where all views are evaluated. Robust weights, and
gradients measured away from the solution, make all steps too short by about the same factor."""
SMOOTHNESS_ROUNDS = 2
"""How often the smoothness is estimated between two evaluations of the images."""
DAMPING = Damping(initial=0.0, grow=1e4, most=1.0)
"""Steps are damped only after one was refused: smoothness makes the diagonal of the normal matrix so large that even a
small share of it would suppress slow corrections over many frames."""

HopelessTest = Callable[[SegmentEvidence, int], bool]
"""Told the evidence and the number of steps that are left at most, returns whether these cannot be worth their time."""
VainTest = Callable[[Sequence[Motion]], bool]
"""Called with motions of F poses per performer, returns whether any further step is in vain."""


@dataclass(frozen=True, eq=False)
class MeasuredEquations(IndependentEquations):
    """The normal equations of all performers, and the measurement that they were built from."""

    measured: MeasuredMotion


@dataclass(frozen=True, eq=False)
class Approach:
    """Where steps that are not tested have led, see `approach`.

    Attributes
    ----------
    motions : tuple of Motion
    energies : tuple of float
        Cost before each iteration.
    seconds : Seconds
    smooth : SegmentSmoothness
        The last estimate.
    """

    motions: tuple[Motion, ...]
    energies: tuple[float, ...]
    seconds: Seconds
    smooth: SegmentSmoothness

    @classmethod
    def start(cls, problem: SegmentProblem, motions: Sequence[Motion]) -> Approach:
        """Return where a descent is before its first step."""
        return cls(tuple(motions), (), Seconds(), SegmentSmoothness.start(problem))

    def counted(self) -> Approach:
        """Return the same for another descent, where its iterations and its time are counted already."""
        return replace(self, energies=(), seconds=Seconds())


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
        *,
        hopeless: HopelessTest | None = None,
        vain: VainTest | None = None,
        plants: Sequence[PlantFactor | None] | None = None,
    ) -> None:
        self.smooth = smooth
        self.seconds, self.trials = Seconds(), 0
        self._problem, self._stage, self._workspace, self._noise = problem, stage, workspace, noise
        self._hidden: list[NDArray[np.bool_]] | None = None
        self._expected: list[Array] = []
        self._plants = plants
        self._tied: TiedSystems | None = None
        self._pace = OVERRELAXATION
        self._hopeless, self._vain, self._done = hopeless, vain, 0
        self._evidence: SegmentEvidence | None = None

    def minimise(self, start: tuple[Motion, ...]) -> LeastSquaresResult[tuple[Motion, ...], MeasuredEquations]:
        """Descend from the start."""
        stage = self._stage
        stopping = StoppingRule(
            stage.iterations + MAX_EXTRA_ITERATIONS,
            SMALL_GAIN,
            stage.small,
            self._distance,
            small_refused=stage.small_refused,
            # A step's gain is the square of its length in standard deviations.
            least_promise=stage.noticed**2
            * sum(np.count_nonzero(~self._problem.fixed[i]) for i in self._problem.sought),
            negligible=self._not_worth_it if stage.negligible or self._hopeless or self._vain else None,
        )
        return minimise(
            start, self._linearise, self._moved, damping=DAMPING, stopping=stopping, on_iteration=self._begin_step
        )

    def _linearise(self, motions: tuple[Motion, ...]) -> MeasuredEquations:
        """Measure the evidence at motions and build the normal equations."""
        problem, sampling = self._problem, self._stage.sampling
        sigma = None if self._noise is None else self._noise.sigma
        measured = self._workspace.measure(problem, motions, sampling, sigma)
        evidence = measured.evidence
        self.seconds.add(evidence.seconds)
        if self._hopeless is not None:
            self._evidence = evidence
        with self.seconds.measure("solve"):
            if self._noise is None:
                self._noise = SegmentNoise.of(evidence, problem.settings)
            begins = self._hidden is None
            if self._hidden is None:
                self._hidden, self._expected = hidden_and_expected(problem, motions, evidence)
                if self._plants is None and (self._stage.plants or not problem.shows_depth):
                    self._plants = plants_of(problem, motions)
            images = evidence_equations(problem, measured, self._hidden, self._noise)
            if begins:
                self.smooth = self.smooth.estimated(problem, motions, images, self._expected, rounds=SMOOTHNESS_ROUNDS)
            systems = with_priors(problem, motions, images, self.smooth, self._expected)
            if self._plants is not None:
                systems = with_plants(systems, self._plants, problem.bodies, motions)
            systems = with_contact(systems, problem.contact, problem.bodies, motions, problem.sought)
            self._tied = problem.tied(systems, motions)
            return MeasuredEquations(self._tied.systems, measured)

    def _begin_step(self, done: int, motions: tuple[Motion, ...]) -> None:
        self.trials += 1
        self._done = done
        self._pace = OVERRELAXATION if done + 1 < self._stage.iterations else 1.0
        self._workspace.report(1 - (1 - _STEP_SHARE) ** done, motions)

    def _distance(self, before: tuple[Motion, ...], after: tuple[Motion, ...]) -> float:
        """Root mean square of the step between two motions, radians and metres.

        It is 0, which ends the stage, if all joints are at rest (`at_rest`), to within `DescentStage.still` or, once
        the stage's iterations are over, `UNCONVERGED_MOVE`.
        """
        over = self.trials >= self._stage.iterations
        if at_rest(self._problem, before, after, UNCONVERGED_MOVE if over else self._stage.still):
            return 0.0
        return _size([before[i].difference(after[i]) for i in self._problem.sought])

    def _not_worth_it(self, before: tuple[Motion, ...], after: tuple[Motion, ...]) -> bool:
        """Whether a step would hardly move anything, is in vain or, once the stage's iterations are over, hopeless."""
        stage, left = self._stage, self._stage.iterations + MAX_EXTRA_ITERATIONS - self._done
        if stage.negligible and at_rest(self._problem, before, after, stage.negligible):
            return True
        if self._vain is not None and self._vain(before):
            return True
        if self._hopeless is None:
            return False
        assert self._evidence is not None
        return self._hopeless(self._evidence, left) and self._done >= stage.iterations

    def _moved(self, motions: tuple[Motion, ...], steps: Sequence[Array]) -> tuple[Motion, ...]:
        assert self._tied is not None
        return moved_by(motions, increments_of(self._tied, steps, self._pace))


def refine(
    problem: SegmentProblem,
    start: Sequence[Motion],
    workspace: Workspace,
    stages: Sequence[DescentStage] = REFINEMENT,
    *,
    repeated: Callable[[SegmentSolution, Workspace], SegmentSolution] | None = None,
) -> SegmentSolution:
    """Refine a solution once the motion on both sides of the segment is known.

    The last stage keeps the noise and the smoothness of its start. If it moves some joint by more than
    `UNCONVERGED_MOVE`, they no longer fit, and it is repeated, up to `MAX_REPEATS` times.

    Parameters
    ----------
    problem, start, workspace, stages
        See `descend`.
    repeated : callable, optional
        Repeats the last stage from a solution; by default on all frames.
    """
    found = descend(problem, start, workspace.part(0.0, _DESCENT_SHARE), stages)
    seconds = Seconds(found.seconds)
    for again in range(1, 1 + MAX_REPEATS):
        if found.moved.max() < UNCONVERGED_MOVE:
            break
        part = workspace.part(1 - (1 - _DESCENT_SHARE) ** again, 1 - (1 - _DESCENT_SHARE) ** (again + 1))
        found = found.without_equations()  # those of a long segment are large, and new ones follow
        further = descend(problem, found.motions, part, stages[-1:]) if repeated is None else repeated(found, part)
        seconds.add(further.seconds)
        found = continued(found, further)
    return replace(found, seconds=seconds)


def continued(before: SegmentSolution, after: SegmentSolution) -> SegmentSolution:
    """Return the second of two solutions, which the first has led to, with the iterations of both."""
    return replace(after, iterations=before.iterations + after.iterations, energy=(*before.energy, *after.energy))


def farthest_joint(problem: SegmentProblem, before: Sequence[Motion], after: Sequence[Motion]) -> float:
    """Largest distance between the positions of a joint in two motions, over all frames and the performers that are
    solved for, metres.
    """
    return float(joint_moves(problem, before, after).max())


def joint_moves(problem: SegmentProblem, before: Sequence[Motion], after: Sequence[Motion]) -> Array:
    """The same distance on each frame, shape (F,)."""
    joints = [[part_poses(problem.bodies[i], m[i])[1] for m in (before, after)] for i in problem.sought]
    return np.max([np.linalg.norm(b - a, axis=-1).max(axis=1) for a, b in joints], axis=0)


def at_rest(problem: SegmentProblem, before: Sequence[Motion], after: Sequence[Motion], most: float) -> bool:
    """Whether from one motion to another no joint moves by so much, metres, nor the tip of any part by more than
    `UNCONVERGED_MOVE`: a hand may turn while all joints stay where they are.
    """
    if farthest_joint(problem, before, after) >= most:
        return False
    for i in problem.sought:
        body = problem.bodies[i]
        earlier, later = (tip_positions(body, part_poses(body, m[i])) for m in (before, after))
        if np.linalg.norm(later - earlier, axis=-1).max() >= UNCONVERGED_MOVE:
            return False
    return True


def descend(
    problem: SegmentProblem,
    start: Sequence[Motion] | Approach,
    workspace: Workspace,
    stages: Sequence[DescentStage] = STAGES,
    noise: SegmentNoise | None = None,
    *,
    hopeless: HopelessTest | None = None,
    vain: VainTest | None = None,
    plants: Sequence[PlantFactor | None] | None = None,
) -> SegmentSolution:
    """Descend from a start to the nearest minimum, in stages from coarse to fine images.

    Steps of the last stage are refused where they raise the cost; those of the others are not tested, see `approach`.
    Everything in the solution was measured at the motions that are returned.

    Parameters
    ----------
    problem : SegmentProblem
    start : sequence of Motion, or Approach
        F poses per performer; fixed degrees of freedom keep these values. Or where stages before the given ones have
        led.
    workspace : Workspace
        Progress is reported before each iteration.
    stages : sequence of DescentStage
    noise : SegmentNoise, optional
        Noise under which the costs of the last stage are computed; by default it is estimated at the start of that
        stage.
    hopeless : HopelessTest, optional
        Asked before every step of the last stage, which ends by it once its iterations are over.
    vain : VainTest, optional
        Asked before every step of the last stage, which ends by it at once.
    plants : sequence of (PlantFactor or None), optional
        Per performer: the plants that are held in the last stage, if they are known.
    """
    *coarse, last = stages
    share = 1 - last.iterations / sum(stage.iterations for stage in stages)
    begun = approach(problem, start, workspace.part(0.0, share), coarse)
    last = replace(last, sampling=last.sampling_of(views_in_sight(problem, begun.motions)))
    stage = _TestedStage(
        problem, last, workspace.part(share, 1.0), begun.smooth, noise, hopeless=hopeless, vain=vain, plants=plants
    )
    result = stage.minimise(begun.motions)
    with stage.seconds.measure("solve"):
        equations = result.linearised()
    seconds = Seconds(begun.seconds)
    seconds.add(stage.seconds)
    solution = SegmentSolution.of(
        result.state,
        equations.measured.evidence,
        iterations=len(begun.energies) + stage.trials,
        energy=(*begun.energies, *result.cost_history),
        seconds=seconds,
        only=problem.only,
    )
    return replace(solution, variances=stage.smooth.variances, moved=joint_moves(problem, begun.motions, result.state))


def approach(
    problem: SegmentProblem,
    start: Sequence[Motion] | Approach,
    workspace: Workspace,
    stages: Sequence[DescentStage],
) -> Approach:
    """Descend by steps that are not tested; parameters as in `descend`.

    Coarse stages evaluate a different subset of the views at every iteration, so the costs of two iterations cannot be
    compared.
    """
    begin = start if isinstance(start, Approach) else Approach.start(problem, start)
    motions, smooth, energies, seconds = begin.motions, begin.smooth, list(begin.energies), Seconds(begin.seconds)
    planned = sum(stage.iterations for stage in stages)
    for s, stage in enumerate(stages):
        before = sum(earlier.iterations for earlier in stages[:s])
        hidden: list[NDArray[np.bool_]] = []
        expected: list[Array] = []
        for i in range(stage.iterations):
            workspace.report((before + i) / planned, motions)
            seen = problem if stage.views is None else view_subset(problem, stage.views, i)
            measured = workspace.measure(seen, motions, stage.sampling_of(views_in_sight(seen, motions)))
            seconds.add(measured.evidence.seconds)
            longer = i + 1 < stage.iterations and len(seen.views) == len(problem.views)
            pace = OVERRELAXATION if longer else 1.0
            with seconds.measure("solve"):
                if not hidden:
                    hidden, expected = hidden_and_expected(seen, motions, measured.evidence)
                images = evidence_equations(seen, measured, hidden)
                smooth = smooth.estimated(seen, motions, images, expected, rounds=SMOOTHNESS_ROUNDS, bursts=False)
                systems = with_priors(seen, motions, images, smooth, expected)
                tied = seen.tied(systems, motions)
                steps = increments_of(tied, [system.solve(0.0) for system in tied.systems], pace)
                earlier, motions = motions, moved_by(motions, steps)
                energies.append(tied.cost)
            if _size(list(steps.values())) < stage.small:
                break
            if stage.still and farthest_joint(problem, earlier, motions) < stage.still:
                break
    return Approach(motions, tuple(energies), seconds, smooth)


def increments_of(tied: TiedSystems, steps: Sequence[Array], pace: float = 1.0) -> dict[int, Array]:
    """Turn the steps of tied systems, times a pace, into increments (F, D) by performer.

    They are bounded in length (`core.body.smoothness.limited`), and rounded so that all processors give the same bits.
    """
    return {i: on_grid(limited(pace * step)) for i, step in tied.by_performer(steps).items()}


def moved_by(motions: Sequence[Motion], increments: Mapping[int, Array]) -> tuple[Motion, ...]:
    """Return the motions of all performers, moved where there are increments (F, D)."""
    return tuple(m.moved(increments[i]) if i in increments else m for i, m in enumerate(motions))


def _size(steps: Sequence[Array]) -> float:
    """Root mean square of all elements of steps."""
    return float(np.sqrt(np.mean(np.concatenate([step.ravel() for step in steps]) ** 2)))
