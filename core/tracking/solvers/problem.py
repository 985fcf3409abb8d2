"""What a solver is given, a segment with its footage, bodies and constraints, and what it returns."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from enum import Enum

import numpy as np
from numpy.typing import NDArray

from ...body import Body
from ...body.motion import Motion
from ...body.smoothness_estimate import AccelerationVariances, axis_mobility, precision_of
from ...evidence.accumulate import SegmentEvidence
from ...evidence.part_geometry import Geometry
from ...evidence.view_frames import ViewFrames
from ...keypoints.keypoint_factor import KeypointFactor
from ...numerics.arrays import Array, slices_of
from ...numerics.banded_blocks import BandedBlocks
from ...shot.acceleration_prior import usual_variances
from ...shot.shot import Settings
from .contact_factor import ContactFactor
from .hold_factor import HoldFactor, TiedSystems, tied_systems


class AccelerationSearch(Enum):
    """What is estimated of the accelerations, where their variances are not given."""

    JOINTS = "joints"
    """Those of every joint, from where something shows that the estimate begins."""
    SCALE_THEN_JOINTS = "scale, then joints"
    """Those of every joint, if the pictures contradict the usual ones; their scale shows where that begins."""
    SCALE = "scale"
    """Their scale alone, if the pictures contradict the usual ones."""
    KEPT = "kept"
    """Nothing."""


@dataclass(frozen=True, eq=False)
class SegmentProblem:
    """F consecutive frames of all performers.

    Attributes
    ----------
    views : tuple of ViewFrames
    bodies : tuple of Body
        One per performer.
    first : int
        Shot frame of the first of the F frames.
    fps : float
    fixed : tuple of ndarray of bool, shape (F, D)
        Per performer: the degrees of freedom that key poses hold.
    before, after : tuple of Motion or None
        Per performer: the pose on the frame before the first and after the last, where it is known. It is held, and the
        motion passes smoothly from and to it.
    shape : Geometry or None
        The parts of all performers as the key frames show them; None for the bodies' own.
    keypoints : tuple of KeypointFactor
        One per performer, or none.
    footage_offset : float
        See `core.shot.shot.Settings`: what the views show on a frame is that much earlier, frames.
    settings : Settings
    acceleration_precision : tuple of ndarray, optional
        Per performer: inverse variance of the acceleration of each degree of freedom, per frame squared, shape (D,), or
        of each on every frame, (F, D). By default those of `typical_variances`, or estimated from there.
    typical_variances : tuple of ndarray, shape (G,), optional
        Per performer: variances of accelerations where their estimation begins, see `core.body.smoothness_estimate`.
        By default those of usual human motion (`core.shot.acceleration_prior`).
    search : AccelerationSearch
        What is estimated from there.
    only : int, optional
        The performer whose motion is sought; the others' is given. By default all are sought.
    contact : ContactFactor, optional
        Keeps performers out of each other.
    holds : tuple of HoldFactor
        Tie props to what holds them.
    """

    views: tuple[ViewFrames, ...]
    bodies: tuple[Body, ...]
    first: int
    fps: float
    fixed: tuple[NDArray[np.bool_], ...]
    before: tuple[Motion, ...] | None = None
    after: tuple[Motion, ...] | None = None
    shape: Geometry | None = None
    keypoints: tuple[KeypointFactor, ...] = ()
    footage_offset: float = 0.0
    settings: Settings = field(default_factory=Settings)
    acceleration_precision: tuple[Array, ...] | None = None
    typical_variances: tuple[Array, ...] | None = None
    search: AccelerationSearch = AccelerationSearch.JOINTS
    only: int | None = None
    contact: ContactFactor | None = None
    holds: tuple[HoldFactor, ...] = ()

    @property
    def length(self) -> int:
        """Number of frames F."""
        return len(self.fixed[0])

    @property
    def shows_depth(self) -> bool:
        """Whether several views look on: one alone shows little of what moves along its line of sight."""
        return len(self.views) > 1

    def geometry(self) -> Geometry:
        """The parts of all performers."""
        return self.shape or Geometry.of(self.bodies)

    def spans(self) -> list[slice]:
        """The parts of each performer in arrays over all performers' parts."""
        return slices_of(len(body) for body in self.bodies)

    @property
    def sought(self) -> list[int]:
        """The performers whose motion is sought."""
        return list(range(len(self.bodies))) if self.only is None else [self.only]

    def alone(self, performer: int) -> SegmentProblem:
        """Return the problem of one performer among the others, whose motion is given.

        What holds it leads it. What it holds does not: a lost arm could not be found if it were kept at a lost prop.
        """
        if len(self.bodies) == 1:
            return self
        fixed = tuple(f if i == performer else np.ones_like(f) for i, f in enumerate(self.fixed))
        holds = tuple(hold for hold in self.holds if hold.prop == performer)
        return replace(self, only=performer, fixed=fixed, holds=holds)

    def tied(self, systems: Sequence[BandedBlocks], motions: Sequence[Motion]) -> TiedSystems:
        """The normal equations of the performers that are sought, with what holds say of them at motions."""
        return tied_systems(systems, self.holds, self.bodies, motions, fixed=self.fixed, sought=self.sought)

    def whole_keys(self, performer: int) -> NDArray[np.intp]:
        """Frames, of the F, on which every degree of freedom of a performer is fixed."""
        return np.flatnonzero(self.fixed[performer].all(axis=1))

    def around(self, performer: int) -> tuple[Motion | None, Motion | None]:
        """A performer's poses on the frame before the first and after the last, where they are known."""
        before, after = (side[performer] if side else None for side in (self.before, self.after))
        return before, after

    def variances(self, performer: int) -> Array:
        """Variances (G,) where the estimation of a performer's accelerations begins."""
        if self.typical_variances is None:
            return usual_variances(self.bodies[performer], self.fps, self.settings)
        return self.typical_variances[performer]

    def with_smoothness(self, found: Sequence[AccelerationVariances]) -> SegmentProblem:
        """The problem once it was found how smooth its motions are, if that was looked for."""
        if not found:
            return self
        typical, search = tuple(own.typical for own in found), self.search
        if search is not AccelerationSearch.JOINTS:
            usual = all(np.array_equal(own, self.variances(i)) for i, own in enumerate(typical))
            joints = search is AccelerationSearch.SCALE_THEN_JOINTS and not usual
            search = AccelerationSearch.JOINTS if joints else AccelerationSearch.KEPT
        return replace(self, typical_variances=typical, search=search)

    def precision(self, performer: int) -> Array:
        """The precision of a performer's accelerations before they are estimated, shape (D,) or (F, D)."""
        if self.acceleration_precision is not None:
            return self.acceleration_precision[performer]
        return precision_of(self.variances(performer), axis_mobility(self.bodies[performer]))


@dataclass(frozen=True, eq=False)
class SegmentSolution:
    """What a solver returns; all of it was measured at the motions in it.

    Attributes
    ----------
    motions : tuple of Motion
        F poses per performer.
    iterations : int
    energy : tuple of float
        Cost before each iteration, and of the motions that are returned; comparable within a stage of the solver.
    share : ndarray, shape (V, F, P)
        Visible share of every part.
    explained : ndarray, shape (M, F)
        How much of what looks like each performer its parts cover, over all views: sums of log likelihood ratios.
    unhidden : ndarray, shape (M, F)
        Share of each performer's area, over all views, that the others do not hide.
    residual : ndarray, shape (F,)
        Root mean square grey-level difference of the pairs of frames at each frame, 0 to 1.
    seconds : dict
        Time spent, by stage.
    evidence : SegmentEvidence, optional
    variances : tuple of AccelerationVariances
        Per performer: how smooth the motion was found to be. Empty where the solver does not estimate it.
    only : int, optional
        The performer whose motion was sought, see `SegmentProblem`.
    """

    motions: tuple[Motion, ...]
    iterations: int
    energy: tuple[float, ...]
    share: Array
    explained: Array
    unhidden: Array
    residual: Array
    seconds: dict[str, float]
    evidence: SegmentEvidence | None = None
    variances: tuple[AccelerationVariances, ...] = ()
    only: int | None = None

    @classmethod
    def of(
        cls,
        motions: Sequence[Motion],
        evidence: SegmentEvidence,
        *,
        iterations: int,
        energy: Sequence[float],
        seconds: dict[str, float] | None = None,
        variances: tuple[AccelerationVariances, ...] = (),
        only: int | None = None,
    ) -> SegmentSolution:
        """A solution with what the evidence that was measured at its motions says of them."""
        return cls(
            tuple(motions),
            iterations,
            tuple(energy),
            evidence.share,
            evidence.explained.sum(axis=0),
            evidence.unhidden,
            frame_residual(evidence),
            {} if seconds is None else seconds,
            evidence,
            variances,
            only,
        )

    @property
    def cover(self) -> float:
        """How much of what looks like the performers their parts cover on all frames."""
        return float(self.explained.sum())

    @property
    def sought_cover(self) -> float:
        """The `cover` of the performers whose motion was sought."""
        return self.cover if self.only is None else float(self.explained[self.only].sum())


def frame_residual(evidence: SegmentEvidence) -> Array:
    """Root mean square residual of the pairs on both sides of each frame, shape (F,)."""
    energy, weight = evidence.gradients.energy.sum(axis=0), evidence.gradients.weight.sum(axis=0)
    both = [np.append(x, 0.0) + np.insert(x, 0, 0.0) for x in (energy, weight)]
    return np.sqrt(both[0] / np.maximum(both[1], 1e-12))
