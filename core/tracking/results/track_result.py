"""What tracking returns."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from ...body.motion import Motion
from ...keypoints.observations import ShotKeypoints
from ...numerics.arrays import Array, Bools
from ...shot.footage_faults.footage_damage import FootageDamage
from ...shot.footage_faults.footage_times import FootageRate
from ...shot.footage_faults.frame_pattern import FramePattern
from ...shot.shot import Gap
from ..expected_errors.uncertainty import JointErrors
from .late_views import LateView


@dataclass(frozen=True, eq=False)
class SegmentResult:
    """The solver's run over one segment.

    Attributes
    ----------
    first, last : int
        Shot frames, inclusive.
    iterations : int
    energy : tuple of float
        Cost before each iteration and at the end, see `SegmentSolution`.
    accelerations : tuple of ndarray, shape (G,)
        Per performer: the typical accelerations that were estimated, of the root's position in m/s^2 and of every
        part's joint in rad/s^2. Empty if none were estimated.
    """

    first: int
    last: int
    iterations: int
    energy: tuple[float, ...]
    accelerations: tuple[Array, ...] = ()


@dataclass(frozen=True, eq=False)
class TrackResult:
    """Tracked motion, and how it was found.

    Attributes
    ----------
    motions : tuple of Motion
        One per performer, every frame of the shot; key poses are as they were set.
    seconds : dict of str to float
        Time spent, by stage.
    camera_frames : int
        Views times frames.
    segments : tuple of SegmentResult
    visible : tuple of ndarray, shape (V, F, P)
        Per performer: visible share of each part's projected area, 0 to 1.
    residual : tuple of ndarray, shape (F,)
        Per performer: root mean square grey-level difference between neighbouring frames, 0 to 1.
    errors : tuple of JointErrors
        Per performer: how far every part's tip may be from its true place, and where it may be lost.
    pictures : tuple of dict of int to ndarray of uint8, shape (h, w, 3)
        Per view: the requested pictures by frame, counted from the shot's first; rectified; blue, green, red.
    observed : ShotKeypoints
        The keypoints that were used; empty if there are none.
    unknown : tuple of tuple of str
        Per performer: the parts that no key pose, keypoint or picture shows on any frame; they keep their rest
        rotation.
    planted : tuple of (ndarray of bool, shape (F, C), or None)
        Per performer: when each point of its soles (`core.body.soles.Soles`) stood: while it was held, as plants that
        passed their tests are, or on a frame beside, it hardly moved. None if plants were not tested: with one view,
        with `plants` switched off, or for a body without feet.
    footage_offset : float
        How much later than on their frames the footage shows the key poses, frames; see `core.shot.settings.Settings`.
    torn : tuple of tuple of int
        Per view: frames, counted from the shot's first, that do not continue the frame before; see
        `core.shot.footage_faults.continuity`.
    gaps : tuple of tuple of Gap
        Per view: where its footage lacks frames or has them once too often, as its frames were counted.
    turns : tuple of (ndarray, shape (F, 3, 3), or None)
        Per view: how its camera was found to turn, see `core.tracking.footage_reading.turned_cameras`; None if it is as
        calibrated.
    late : tuple of LateView or None
        Per view: from which frame on it is early or late with these gaps, if it is.
    rates : tuple of FootageRate or None
        Per view: its frame rate; None if the container does not state times.
    patterns : tuple of FramePattern
        Per view: how the frames of its footage were made from others.
    damage : tuple of FootageDamage or None
        Per view: damage that its decoder reported; empty if there was none, or it was not recorded.
    """

    motions: tuple[Motion, ...]
    seconds: dict[str, float]
    camera_frames: int
    segments: tuple[SegmentResult, ...]
    visible: tuple[Array, ...]
    residual: tuple[Array, ...]
    errors: tuple[JointErrors, ...]
    unknown: tuple[tuple[str, ...], ...]
    pictures: tuple[dict[int, NDArray[np.uint8]], ...] = ()
    observed: ShotKeypoints = field(default_factory=ShotKeypoints)
    planted: tuple[Bools | None, ...] = ()
    footage_offset: float = 0.0
    torn: tuple[tuple[int, ...], ...] = ()
    gaps: tuple[tuple[Gap, ...], ...] = ()
    turns: tuple[Array | None, ...] = ()
    late: tuple[LateView | None, ...] = ()
    rates: tuple[FootageRate | None, ...] = ()
    patterns: tuple[FramePattern, ...] = ()
    damage: tuple[FootageDamage | None, ...] = ()

    def of_views(self, views: Sequence[int]) -> TrackResult:
        """Return the same result with the views in another order, as indices into these."""
        order = list(views)
        return replace(
            self,
            visible=tuple(share[order] for share in self.visible),
            pictures=tuple(self.pictures[v] for v in order),
            observed=self.observed.of_views(order),
            torn=tuple(self.torn[v] for v in order),
            gaps=tuple(self.gaps[v] for v in order) if self.gaps else (),
            turns=tuple(self.turns[v] for v in order) if self.turns else (),
            late=tuple(self.late[v] for v in order) if self.late else (),
            rates=tuple(self.rates[v] for v in order),
            patterns=tuple(self.patterns[v] for v in order),
            damage=tuple(self.damage[v] for v in order) if self.damage else (),
        )

    @property
    def deviation(self) -> tuple[Array, ...]:
        """Per performer: expected distance of every part's tip from its true position, metres, shape (F, P)."""
        return tuple(own.deviation for own in self.errors)
