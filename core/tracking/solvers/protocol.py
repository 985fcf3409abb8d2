"""The interface of a solver: the functions that the tracker calls, and what the solver is capable of."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

from ...body.motion import Motion
from ...numerics.arrays import Array, Bools, Ints
from ...numerics.banded_blocks import BandedBlocks
from .equations.measurement import Workspace
from .equations.problem import SegmentProblem, SegmentSolution


class Solve(Protocol):
    """Solves for the motion of all performers on a segment."""

    def __call__(self, problem: SegmentProblem, start: Sequence[Motion], workspace: Workspace) -> SegmentSolution:
        """Solve from a start: F poses per performer. Degrees of freedom that key poses fix keep the start's values."""


class Resume(Protocol):
    """Updates the motion of a segment after its key poses have changed a little."""

    def __call__(
        self, problem: SegmentProblem, start: Sequence[Motion], workspace: Workspace, before: Sequence[Motion]
    ) -> SegmentSolution | None:
        """Solve from the earlier motion; return None where the images cast doubt on the result.

        Parameters
        ----------
        problem : SegmentProblem
        start : sequence of Motion
            The earlier motion, bent to pass through the key poses of now.
        workspace : Workspace
        before : sequence of Motion
            The earlier motion itself.
        """


@dataclass(frozen=True, eq=False)
class SettledMotions:
    """The motions of a segment once feet that stand are at rest.

    Attributes
    ----------
    motions : tuple of Motion
        F poses per performer.
    planted : tuple of (ndarray of bool, shape (F, C), or None)
        Per performer: when each point of its soles (`core.body.soles.Soles`) is held where it stands, the ball where
        the foot rolls (`forefoot_rocker`), or stands between key poses on neighbouring frames. None where no plant was
        tested.
    """

    motions: tuple[Motion, ...]
    planted: tuple[Bools | None, ...]


@dataclass(frozen=True, eq=False)
class SolvedFrames:
    """The motions before refinement on a segment and on the segments beside it that are solved.

    Attributes
    ----------
    motions : tuple of Motion
        One per performer.
    first : int
        Number of these frames before the segment.
    keyed : tuple of ndarray of int
        Per performer: those of the frames that have a key pose of the whole body. Empty if that is not known.
    """

    motions: tuple[Motion, ...]
    first: int = 0
    keyed: tuple[Ints, ...] = ()


class Settle(Protocol):
    """Corrects a refined solution so that standing feet are at rest."""

    def __call__(
        self,
        problem: SegmentProblem,
        solution: SegmentSolution,
        equations: Sequence[BandedBlocks],
        before: SolvedFrames,
        ratios: Sequence[Array],
        *,
        workspace: Workspace,
    ) -> SettledMotions:
        """Return the corrected poses, and which points of the soles are held.

        Parameters
        ----------
        problem : SegmentProblem
        solution : SegmentSolution
            After refinement. Degrees of freedom that key poses fix keep its values.
        equations : sequence of BandedBlocks
            Normal equations of every performer at the solution, without those of plants and holds.
        before : SolvedFrames
            The motions before refinement.
        ratios : sequence of ndarray, shape (P,)
            Per performer: squared errors of the parts' tips over those that the solver predicts.
        workspace : Workspace
        """


@dataclass(frozen=True)
class Solver:
    """A method that solves for the motion of all performers on a segment, and its capabilities.

    Attributes
    ----------
    solve : callable
        See `Solve`.
    refine : callable, optional
        Like `solve`, but starts from a solution, once the motion on both sides of the segment is known. None: solutions
        stay as they are.
    resume : callable, optional
        See `Resume`. None: segments are always solved anew.
    settle : callable, optional
        See `Settle`; it is called once a segment is refined. None: solutions stay as they are.
    uses_keypoints : bool
        Keypoints of the views are part of the evidence.
    uses_foreground : bool
        Foreground images are part of the evidence. They are computed only for solvers that use them.
    uses_holds : bool
        Props are kept in the hands that hold them.
    """

    solve: Solve
    refine: Solve | None
    resume: Resume | None
    settle: Settle | None
    uses_keypoints: bool
    uses_foreground: bool
    uses_holds: bool
