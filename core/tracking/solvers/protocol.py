"""What the tracker expects of a solver."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

from ...body.motion import Motion
from .measurement import Workspace
from .problem import SegmentProblem, SegmentSolution


class Solver(Protocol):
    """A way to find the motion of all performers on a segment, and what it is capable of."""

    @property
    def uses_keypoints(self) -> bool:
        """Whether it takes the keypoints of the views as evidence."""

    @property
    def uses_foreground(self) -> bool:
        """Whether it takes foreground images as evidence; they are computed only where it does."""

    @property
    def refines(self) -> bool:
        """Whether `refine` improves a solution when motion is known on both sides of the segment."""

    @property
    def gives_covariance(self) -> bool:
        """Whether its solutions have `factors`, from which covariances of the poses follow."""

    def solve(self, problem: SegmentProblem, start: Sequence[Motion], workspace: Workspace) -> SegmentSolution:
        """Find the motion of a segment from a start, F poses per performer whose fixed degrees of freedom are kept."""

    def refine(self, problem: SegmentProblem, start: Sequence[Motion], workspace: Workspace) -> SegmentSolution:
        """Continue from a solution when more is known of the motion around the segment."""
