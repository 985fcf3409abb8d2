"""What a solver is given: one stretch of frames with its evidence, its bodies, and what is fixed."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ...body import Body
from ...body.kinematics import scene_poses
from ...body.motion import Motion, stacked
from ...body.smoothness import smoothness
from ...body.time_shift import Delayed, delayed
from ...evidence.accumulate import Evidence, image_evidence
from ...evidence.label_images import Geometry
from ...evidence.occlusion import unseen
from ...evidence.view_frames import ViewFrames
from ...keypoints.keypoint_factor import KeypointFactor
from ...numerics.banded import BandedFactor
from ...numerics.banded_blocks import BandedBlocks

Array = NDArray[np.float64]
Step = Callable[[float, Sequence[Motion]], None]


@dataclass(frozen=True, eq=False)
class Instants:
    """Views that were taken at the same F instants, and the performers there.

    Attributes
    ----------
    views : list of int
    delay : float
        How much later than the frames the instants are, frames.
    poses : tuple of ndarray, shape (F, P, 3, 3) and (F, P, 3)
        World poses of all performers' parts.
    delayed : tuple of Delayed, optional
        Per performer; none where the instants are the frames.
    """

    views: list[int]
    delay: float
    poses: tuple[Array, Array]
    delayed: tuple[Delayed, ...] | None = None

    def on_frames(self, performer: int, blocks: BandedBlocks) -> BandedBlocks:
        """A performer's system for the poses on the frames, of one for those at the instants."""
        return blocks if self.delayed is None else self.delayed[performer].spread(blocks)


@dataclass(frozen=True, eq=False)
class Problem:
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
    shape : Geometry or None
        The parts of all performers as the key frames show them; None for the bodies' own.
    before, after : tuple of Motion or None
        Per performer: the pose on the frame before the first and after the last, where it is known. It is held, and the
        motion passes smoothly from and to it.
    pointers : tuple of Pointers
        One per performer, or none.
    footage_offset : float
        See `core.shot.shot.Settings`: what the views show on a frame is that much earlier, frames.
    """

    views: tuple[ViewFrames, ...]
    bodies: tuple[Body, ...]
    first: int
    fps: float
    fixed: tuple[NDArray[np.bool_], ...]
    before: tuple[Motion, ...] | None = None
    after: tuple[Motion, ...] | None = None
    shape: Geometry | None = None
    pointers: tuple[KeypointFactor, ...] = ()
    footage_offset: float = 0.0

    @property
    def length(self) -> int:
        return len(self.fixed[0])

    def some_views(self, least: int, turn: int) -> Problem:
        """The problem with every k-th view alone, beginning elsewhere with every turn, so that `least` are left."""
        every = max(1, len(self.views) // least)
        return replace(self, views=self.views[turn % every :: every])

    def geometry(self) -> Geometry:
        return self.shape or Geometry.of(self.bodies)

    def spans(self) -> list[slice]:
        """The parts of each performer in arrays over all performers' parts."""
        ends = np.cumsum([0] + [len(body) for body in self.bodies])
        return [slice(a, b) for a, b in itertools.pairwise(ends)]

    def agreement(self, motions: Sequence[Motion]) -> float:
        """How far keypoints agree with motions, 0 to 1."""
        R, T = self.footage_instants(motions, scene_poses(self.bodies, motions)).poses
        each = [
            pointer.agreement((R[:, span], T[:, span]))
            for pointer, span in zip(self.pointers, self.spans(), strict=True)
        ]
        return float(np.mean(each))

    def whole_keys(self) -> NDArray[np.intp]:
        """Frames, of the F, on which every degree of freedom of all performers is fixed."""
        return np.flatnonzero(np.all([fixed.all(axis=1) for fixed in self.fixed], axis=0))

    def hidden(self, share: Array) -> list[NDArray[np.bool_]]:
        """Per performer: where no view sees a part, (F, P), of shares (V, F, P); where it is keyed it is known."""
        keyed = [f[:, 3:].reshape(len(f), -1, 3).all(axis=2) for f in self.fixed]
        return [unseen(share[..., span]) & ~known for span, known in zip(self.spans(), keyed, strict=True)]

    def smoothness(
        self, performer: int, motion: Motion, precision: Array, expected: Array | None = None
    ) -> BandedBlocks:
        """Smoothness of one performer's F poses, with those that are known around them.

        `expected` are the accelerations (F, D) that cost nothing, in the middle of the frame before and the next.
        """
        around = self._around(performer)
        known = stacked([m for m in (around[0], motion, around[1]) if m is not None])
        start = 0 if around[0] is None else 1
        if expected is not None:
            expected = np.pad(expected, ((start, len(known) - start - self.length), (0, 0)))[1:-1]
        blocks = smoothness(known, precision, expected)
        return blocks.cut(start, start + self.length)

    def evidence(
        self,
        geometry: Geometry,
        motions: Sequence[Motion],
        sigma: float,
        tolerance: float,
        stride: int,
        reach: float = 0.0,
    ) -> tuple[tuple[Array, Array], Evidence]:
        """World poses of all parts, and the evidence around them."""
        poses = scene_poses(self.bodies, motions)
        at = self.poses_by_delay(motions, poses)
        return poses, image_evidence(self.views, geometry, poses, self.first, sigma, tolerance, stride, reach, at)

    def poses_by_delay(self, motions: Sequence[Motion], poses: tuple[Array, Array]) -> dict[float, tuple[Array, Array]]:
        """World poses of all parts that the views show, by the views' delay."""
        return {self.views[i.views[0]].delay: i.poses for i in self.instants(motions, poses)}

    def instants(self, motions: Sequence[Motion], poses: tuple[Array, Array]) -> list[Instants]:
        """The views by when they were taken; `poses` are the motions' world poses on the frames."""
        delays = [view.delay for view in self.views]
        found = []
        for delay in dict.fromkeys(delays):
            views = [v for v, own in enumerate(delays) if own == delay]
            found.append(self._instants(views, delay - self.footage_offset, motions, poses))
        return found

    def footage_instants(self, motions: Sequence[Motion], poses: tuple[Array, Array]) -> Instants:
        """When footage without a delay was taken; keypoints are brought to these instants."""
        return self._instants([], -self.footage_offset, motions, poses)

    def _instants(
        self, views: list[int], delay: float, motions: Sequence[Motion], poses: tuple[Array, Array]
    ) -> Instants:
        if delay == 0:
            return Instants(views, delay, poses)
        there = tuple(delayed(motion, delay, *self._around(i)) for i, motion in enumerate(motions))
        return Instants(views, delay, scene_poses(self.bodies, [d.motion for d in there]), there)

    def _around(self, performer: int) -> tuple[Motion | None, Motion | None]:
        """A performer's poses on the frame before the first and after the last, where they are known."""
        before, after = (side[performer] if side else None for side in (self.before, self.after))
        return before, after


@dataclass(frozen=True, eq=False)
class Solution:
    """What a solver returns.

    Attributes
    ----------
    motions : tuple of Motion
        F poses per performer.
    iterations : int
    energy : tuple of float
        Before each iteration; comparable within a stage of the solver, see there.
    factors : tuple of BandedFactor
        Per performer: the factor of the last normal matrix, whose inverse is the motion's covariance. Empty where the
        solver has none.
    share : ndarray, shape (V, F, P)
        Visible share of every part at the last iteration.
    explained : ndarray, shape (F,)
        How much of what looks like the performers their parts cover, over all views: sums of log likelihood ratios.
    residual : ndarray, shape (F,)
        Root mean square grey-level difference of the pairs of frames at each frame, 0 to 1.
    seconds : dict
        Time spent, by what.
    evidence : Evidence, optional
        That of the last iteration.
    """

    motions: tuple[Motion, ...]
    iterations: int
    energy: tuple[float, ...]
    factors: tuple[BandedFactor, ...]
    share: Array
    explained: Array
    residual: Array
    seconds: dict[str, float]
    evidence: Evidence | None = None


def frame_residual(evidence: Evidence) -> Array:
    """Root mean square residual of the pairs on both sides of each frame, shape (F,)."""
    energy, weight = evidence.energy.sum(axis=0), evidence.weight.sum(axis=0)
    both = [np.append(x, 0.0) + np.insert(x, 0, 0.0) for x in (energy, weight)]
    return np.sqrt(both[0] / np.maximum(both[1], 1e-12))
