"""Gauss-Newton steps, and the first ones of a descent, which are not tested (`gauss_newton.descend`)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ...body.motion import Motion
from ...body.smoothness import limited
from ...numerics.arrays import Array
from ...numerics.repeatable import on_grid
from ...runtime.timing import Seconds
from .descent_stages import DescentStage
from .equations.hold_factor import TiedSystems
from .equations.measurement import Workspace
from .equations.problem import SegmentProblem
from .equations.segment_equations import evidence_equations, hidden_and_expected, with_priors
from .equations.smoothness_factor import SegmentSmoothness
from .joint_moves import farthest_joint
from .view_subsets import view_subset, views_in_sight

OVERRELAXATION = 1.5
"""Factor by which every step of a stage but the last is lengthened, where all views are evaluated. Robust weights, and
gradients measured away from the solution, make all steps too short by about the same factor."""
SMOOTHNESS_ROUNDS = 2
"""How often the smoothness is estimated between two evaluations of the images."""


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
            if step_size(list(steps.values())) < stage.small:
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


def step_size(steps: Sequence[Array]) -> float:
    """Root mean square of all elements of steps."""
    return float(np.sqrt(np.mean(np.concatenate([step.ravel() for step in steps]) ** 2)))
