"""Gauss-Newton over a whole segment: all of its poses are unknown at the same time.

The energy is a negative log likelihood. Its normal equations (`segment_equations`) are block-pentadiagonal and are
solved by a banded Cholesky factorisation. Degrees of freedom that a key pose fixes are not among the unknowns, so key
poses are met exactly.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ...body.motion import Motion
from ...evidence.segment_evidence import SegmentEvidence
from ...numerics.arrays import Array
from ...numerics.least_squares import Damping, LeastSquaresResult, StoppingRule, minimise
from ...numerics.normal_equations import IndependentEquations
from ...runtime.timing import Seconds
from .approach import OVERRELAXATION, SMOOTHNESS_ROUNDS, Approach, approach, increments_of, moved_by, step_size
from .descent_stages import REFINEMENT, STAGES, UNCONVERGED_MOVE, DescentStage
from .equations.contact_factor import with_contact
from .equations.hold_factor import TiedSystems
from .equations.measurement import MeasuredMotion, Workspace
from .equations.plant_factor import PlantFactor, plants_of, with_plants
from .equations.problem import SegmentProblem, SegmentSolution
from .equations.segment_equations import SegmentNoise, evidence_equations, hidden_and_expected, with_priors
from .equations.smoothness_factor import SegmentSmoothness
from .joint_moves import at_rest, joint_moves
from .view_subsets import views_in_sight

MAX_REPEATS = 3
"""Most repetitions of a refinement."""
_STEP_SHARE, _DESCENT_SHARE = 0.4, 0.7
"""Shares that a step of a tested stage, and a descent of a refinement, take of the progress that is left: most stages
end after a few steps, and most refinements after one descent."""
SMALL_GAIN = 1e-6
"""Relative decrease of the cost below which a stage ends."""
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
            stage.iterations + stage.further,
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
        return step_size([before[i].difference(after[i]) for i in self._problem.sought])

    def _not_worth_it(self, before: tuple[Motion, ...], after: tuple[Motion, ...]) -> bool:
        """Whether a step would hardly move anything, is in vain or, once the stage's iterations are over, hopeless."""
        stage, left = self._stage, self._stage.iterations + self._stage.further - self._done
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
    share = 1 - last.iterations / max(sum(stage.iterations for stage in stages), 1)
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
