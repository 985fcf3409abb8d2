"""Input and output of a solver: a segment with its footage, bodies and constraints, and the motion found for it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from enum import Enum

import numpy as np
from numpy.typing import NDArray

from ....body import Body
from ....body.motion import Motion
from ....body.smoothness_estimate import AccelerationVariances, axis_mobility, precision_of
from ....evidence.misfit import Misfit
from ....evidence.rendering.part_geometry import Geometry
from ....evidence.segment_evidence import SegmentEvidence
from ....evidence.view_frames import ViewFrames
from ....keypoints.keypoint_factor import KeypointFactor
from ....numerics.arrays import Array, Bools, slices_of
from ....numerics.banded_blocks import BandedBlocks
from ....shot.acceleration_prior import usual_variances
from ....shot.settings import Settings
from .contact_factor import ContactFactor
from .hold_factor import HoldFactor, TiedSystems, tied_systems

WIDEST_STEP = 4
"""Most frames from one to the next where frames are left out."""


class AccelerationSearch(Enum):
    """Which variances of the accelerations are estimated from the footage, where they are not given."""

    JOINTS = "joints"
    """One for every joint, starting from the typical variances of the problem."""
    SCALE_THEN_JOINTS = "scale, then joints"
    """First a common scale of all usual variances; if it differs clearly from 1, then one variance for every joint."""
    SCALE = "scale"
    """A common scale of all usual variances, which stay as they are unless the scale differs clearly from 1."""
    KEPT = "kept"
    """None: the variances stay as they are."""


@dataclass(frozen=True, eq=False)
class SegmentProblem:
    """What is known of F consecutive frames of all performers, between two key poses.

    Attributes
    ----------
    views : tuple of ViewFrames
    bodies : tuple of Body
        One per performer.
    first : int
        Shot frame of the first of the F frames.
    fps : float
    fixed : tuple of ndarray of bool, shape (F, D)
        Per performer: the degrees of freedom that key poses fix on each frame.
    before, after : tuple of Motion or None
        Per performer: the pose on the frame before the first and on the one after the last, where it is known. It is
        held fixed, and the motion joins it smoothly.
    shape : Geometry or None
        Shapes of all performers' parts as estimated on the key frames; None for those of the bodies.
    keypoints : tuple of KeypointFactor
        One per performer; empty without keypoints.
    footage_offset : float
        Frames by which the footage lags the key poses, see `core.shot.settings.Settings`: on frame f the views show the
        motion of frame f - footage_offset.
    settings : Settings
    acceleration_precision : tuple of ndarray, optional
        Per performer: inverse variance of the acceleration of each degree of freedom, shape (D,), or of each on every
        frame, shape (F, D); accelerations in metres or radians per frame squared. By default it is computed from
        `typical_variances`, which may then be estimated from the footage, see `search`.
    typical_variances : tuple of ndarray, shape (G,), optional
        Per performer: variances of the accelerations of G groups of joints (`core.body.smoothness_estimate`), at which
        their estimation starts. By default those of usual human motion (`core.shot.acceleration_prior`).
    search : AccelerationSearch
        Which of the variances are estimated.
    only : int, optional
        Index of the one performer that is solved for, while the motions of the others are given. By default all are
        solved for.
    contact : ContactFactor, optional
        Keeps the bodies of different performers from passing through each other.
    holds : tuple of HoldFactor
        Tie props to the parts that hold them.
    doubted : tuple of int
        Performers whose images contradicted an earlier solution, see `SegmentSolution.doubted`.
    polished : bool
        Whether that solution is polished, see `SegmentSolution.polished`.
    steps : ndarray, shape (F - 1,), optional
        The time from each frame to the next, in frames (1 / fps); by default one.
    beside : tuple of float
        The time from `before` to the first frame, and from the last to `after`.
    beyond : tuple of (tuple of Motion or None)
        Per performer: the poses on up to `WIDEST_STEP` frames before the first and after the last, where known.
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
    doubted: tuple[int, ...] = ()
    polished: bool = False
    steps: Array | None = None
    beside: tuple[float, float] = (1.0, 1.0)
    beyond: tuple[tuple[Motion, ...] | None, tuple[Motion, ...] | None] = (None, None)

    @property
    def times(self) -> Array:
        """The time of each frame since the first, in frames, shape (F,)."""
        return np.arange(self.length, dtype=float) if self.steps is None else np.cumsum([0.0, *self.steps])

    @property
    def length(self) -> int:
        """Number of frames F."""
        return len(self.fixed[0])

    @property
    def shows_depth(self) -> bool:
        """Whether there are several views: a single one hardly shows motion along its line of sight."""
        return len(self.views) > 1

    def geometry(self) -> Geometry:
        """Shapes of the parts of all performers."""
        return self.shape or Geometry.of(self.bodies)

    def spans(self) -> list[slice]:
        """For each performer, the slice of its parts in arrays over the parts of all performers."""
        return slices_of(len(body) for body in self.bodies)

    @property
    def sought(self) -> list[int]:
        """Indices of the performers that are solved for."""
        return list(range(len(self.bodies))) if self.only is None else [self.only]

    @property
    def searched(self) -> list[int]:
        """Indices of the performers that are solved for but for those who are held: their motion is given on every
        frame, or all of it but the last part's, by which such frames are not key poses of the whole body.
        """
        return [i for i in self.sought if not self.fixed[i][:, :-3].all()]

    @property
    def among_others(self) -> bool:
        """Whether there are several performers. Others then hide much of each, and much that seems lost is not: all
        pixels count before anybody is doubted, each performer is searched for limbs only as long as any are found, and
        is corrected limb by limb in the refinement.
        """
        return len(self.bodies) > 1

    def alone(self, performer: int) -> SegmentProblem:
        """Return the problem of one performer, the motions of all others being given.

        A prop stays tied to the performer that holds it. A performer is not tied to the props that it holds: a lost arm
        could not be found again if it were kept at a lost prop.
        """
        if not self.among_others:
            return self
        fixed = tuple(f if i == performer else np.ones_like(f) for i, f in enumerate(self.fixed))
        holds = tuple(hold for hold in self.holds if hold.prop == performer)
        return replace(self, only=performer, fixed=fixed, holds=holds)

    def tied(self, systems: Sequence[BandedBlocks], motions: Sequence[Motion]) -> TiedSystems:
        """Return the normal equations of the performers that are solved for, with those of the holds at the motions."""
        return tied_systems(systems, self.holds, self.bodies, motions, fixed=self.fixed, sought=self.sought)

    def whole_keys(self, performer: int) -> NDArray[np.intp]:
        """Return the frames of the segment on which a key pose fixes every degree of freedom of a performer."""
        return np.flatnonzero(self.fixed[performer].all(axis=1))

    def fixed_axes(self, performer: int) -> Bools:
        """Return about which axes key poses fix the rotation of each part of a performer, shape (F, P, 3)."""
        return self.fixed[performer][:, 3:].reshape(self.length, -1, 3)

    def around(self, performer: int) -> tuple[Motion | None, Motion | None]:
        """Return a performer's poses on the frame before the first and after the last, where they are known."""
        before, after = (side[performer] if side else None for side in (self.before, self.after))
        return before, after

    def known_steps(self, performer: int) -> Array | None:
        """Return the time from each known pose of a performer to the next, with those before and after; None where all
        are one.
        """
        if self.steps is None:
            return None
        known = zip(self.around(performer), self.beside, strict=True)
        before, after = ([step] if side is not None else [] for side, step in known)
        return np.array([*before, *self.steps, *after])

    def variances(self, performer: int) -> Array:
        """Variances (G,) at which the estimation for a performer starts."""
        if self.typical_variances is None:
            return usual_variances(self.bodies[performer], self.fps, self.settings)
        return self.typical_variances[performer]

    def with_smoothness(self, found: Sequence[AccelerationVariances]) -> SegmentProblem:
        """Return the problem with estimated variances as its typical ones; unchanged where none were estimated."""
        if not found:
            return self
        typical, search = tuple(own.typical for own in found), self.search
        if search is not AccelerationSearch.JOINTS:
            usual = all(np.array_equal(own, self.variances(i)) for i, own in enumerate(typical))
            joints = search is AccelerationSearch.SCALE_THEN_JOINTS and not usual
            search = AccelerationSearch.JOINTS if joints else AccelerationSearch.KEPT
        return replace(self, typical_variances=typical, search=search)

    def precision(self, performer: int) -> Array:
        """Precision of a performer's accelerations before any estimation, shape (D,) or (F, D)."""
        if self.acceleration_precision is not None:
            return self.acceleration_precision[performer]
        return precision_of(self.variances(performer), axis_mobility(self.bodies[performer]))


@dataclass(frozen=True, eq=False)
class SegmentSolution:
    """The motion that a solver found; everything else in it was measured at exactly this motion.

    Attributes
    ----------
    motions : tuple of Motion
        F poses per performer.
    iterations : int
    energy : tuple of float
        Cost before each iteration, and at the end that of `motions`. Costs of different stages cannot be compared.
    share : ndarray, shape (V, F, P)
        Visible share of the projected area of every part, 0 to 1.
    explained : ndarray, shape (M, F)
        Per performer: sum over all views of the log likelihood ratios (performer against background) of the pixels that
        the performer's parts cover.
    unhidden : ndarray, shape (M, F)
        Share of each performer's area, over all views, that the others do not hide.
    residual : ndarray, shape (F,)
        Root mean square of the grey-level residuals of the pairs of frames that a frame belongs to, 0 to 1.
    seconds : dict
        Time spent, by stage.
    evidence : SegmentEvidence, optional
        Evidence of the images at the motions.
    variances : tuple of AccelerationVariances
        Per performer: estimated variances of the accelerations; empty where the solver does not estimate them.
    only : int, optional
        Index of the performer that was solved for, see `SegmentProblem`; None for all.
    doubted : tuple of int
        Performers whose images contradicted the first solution, so that others were searched for.
    polished : bool
        Whether the motions of all performers but those in doubt are at rest under the noise of each part.
    moved : ndarray, shape (F,)
        Largest distance by which the last stage, which keeps the noise and the smoothness of its start, moved a joint
        on each frame, metres; empty where it was not measured.
    misfit : Misfit, optional
        Where the images do not fit the motions, if it was measured.
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
    doubted: tuple[int, ...] = ()
    polished: bool = False
    moved: Array = field(default_factory=lambda: np.zeros(0))
    misfit: Misfit | None = None

    @classmethod
    def of(
        cls,
        motions: Sequence[Motion],
        evidence: SegmentEvidence,
        *,
        iterations: int,
        energy: Sequence[float],
        seconds: dict[str, float] | None = None,
        only: int | None = None,
    ) -> SegmentSolution:
        """Build a solution from motions and the evidence that was measured at them."""
        return cls(
            motions=tuple(motions),
            iterations=iterations,
            energy=tuple(energy),
            share=evidence.share,
            explained=evidence.explained.sum(axis=0),
            unhidden=evidence.unhidden,
            residual=frame_residual(evidence),
            seconds={} if seconds is None else seconds,
            evidence=evidence,
            only=only,
        )

    def without_equations(self) -> SegmentSolution:
        """Return the solution without the normal equations of its evidence, which comparisons do not need: a search in
        a long segment holds many solutions.
        """
        return self if self.evidence is None else replace(self, evidence=self.evidence.without_equations())

    @property
    def cover(self) -> float:
        """Sum of `explained` over all performers and frames: how well the parts cover the foreground."""
        return float(self.explained.sum())

    @property
    def sought_cover(self) -> float:
        """The `cover` of the performers that were solved for."""
        return self.cover if self.only is None else float(self.explained[self.only].sum())


def frame_residual(evidence: SegmentEvidence) -> Array:
    """Root mean square grey-level residual of the pairs of frames on both sides of each frame, shape (F,)."""
    energy, weight = evidence.gradients.energy.sum(axis=0), evidence.gradients.weight.sum(axis=0)
    both = [np.append(x, 0.0) + np.insert(x, 0, 0.0) for x in (energy, weight)]
    return np.sqrt(both[0] / np.maximum(both[1], 1e-12))
