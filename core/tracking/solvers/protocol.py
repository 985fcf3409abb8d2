"""What the tracker expects of a solver."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

from ...body.motion import Motion
from .measurement import Workspace
from .problem import SegmentProblem, SegmentSolution


class Solve(Protocol):
    """Finds the motion of a segment."""

    def __call__(self, problem: SegmentProblem, start: Sequence[Motion], workspace: Workspace) -> SegmentSolution:
        """Find it from a start, F poses per performer whose fixed degrees of freedom are kept."""


class Resume(Protocol):
    """Finds the motion of a segment from one that was found before."""

    def __call__(
        self, problem: SegmentProblem, start: Sequence[Motion], workspace: Workspace
    ) -> SegmentSolution | None:
        """Find it from a start, or give None."""


class Settle(Protocol):
    """Moves the motions of a solution to where feet that stand are at rest."""

    def __call__(
        self, problem: SegmentProblem, solution: SegmentSolution, before: Sequence[Motion]
    ) -> tuple[Motion, ...]:
        """Give F poses per performer, from those of a solution and of what was before its refinement; degrees of
        freedom that key poses hold are those of the solution.
        """


@dataclass(frozen=True)
class Solver:
    """A way to find the motion of all performers on a segment, and what it is capable of.

    Attributes
    ----------
    solve : callable
        See `Solve`.
    refine : callable
        The same from a solution, when more is known of the motion around the segment.
    resume : callable, optional
        The same from the motion as it was before key poses changed a little; it gives None where the images leave a
        doubt that this leads to the solution.
    settle : callable, optional
        What the motions of a segment are moved by at its end, see `Settle`.
    uses_keypoints : bool
        It takes the keypoints of the views as evidence.
    uses_foreground : bool
        It takes foreground images as evidence; they are computed only where it does.
    uses_holds : bool
        It keeps props in the hands that hold them.
    refines : bool
        `refine` improves a solution when motion is known on both sides of the segment.
    """

    solve: Solve
    refine: Solve
    resume: Resume | None
    settle: Settle | None
    uses_keypoints: bool
    uses_foreground: bool
    uses_holds: bool
    refines: bool
