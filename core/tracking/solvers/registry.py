"""The solvers by the names that a shot's settings have for them (`core.shot.shot.SOLVERS`)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

from ...body.motion import Motion
from . import gauss_newton, multi_start, relaxation
from .measurement import Workspace
from .problem import SegmentProblem, SegmentSolution
from .protocol import Solver


@dataclass(frozen=True)
class GaussNewtonSolver:
    """Gauss-Newton over all poses of a segment at once, from several starts where the images leave a doubt."""

    uses_keypoints: bool = True
    uses_foreground: bool = True
    refines: bool = True
    gives_covariance: bool = True

    def solve(self, problem: SegmentProblem, start: Sequence[Motion], workspace: Workspace) -> SegmentSolution:
        """Descend from the start, and from others where the result is in doubt."""
        return multi_start.best_of_starts(problem, start, workspace)

    def refine(self, problem: SegmentProblem, start: Sequence[Motion], workspace: Workspace) -> SegmentSolution:
        """Descend a little farther."""
        return gauss_newton.refine(problem, start, workspace)


@dataclass(frozen=True)
class RelaxationSolver:
    """The published relaxation, by gradients between neighbouring frames alone."""

    uses_keypoints: bool = False
    uses_foreground: bool = False
    refines: bool = False
    gives_covariance: bool = False

    def solve(self, problem: SegmentProblem, start: Sequence[Motion], workspace: Workspace) -> SegmentSolution:
        """Follow the gradients from the first pose, then relax towards the last."""
        return relaxation.relaxed(problem, start, workspace)

    def refine(self, problem: SegmentProblem, start: Sequence[Motion], workspace: Workspace) -> SegmentSolution:
        """Solve anew: relaxation takes nothing from a start but its key poses, nor from motion beside the segment."""
        return self.solve(problem, start, workspace)


REGISTRY: Mapping[str, Solver] = MappingProxyType(
    {"gauss-newton": GaussNewtonSolver(), "relaxation": RelaxationSolver()}
)


def solver_named(name: str) -> Solver:
    """Return the solver with a name of `core.shot.shot.SOLVERS`."""
    return REGISTRY[name]
