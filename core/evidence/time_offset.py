"""The time offset between key poses and footage.

Key poses that were measured, or that belong to views synchronised to whole frames, may show an instant a little before
or after their frame. On the key frames, the outlines of moving parts are then displaced in proportion to their speed,
while errors of the body's shape are the same on all key frames.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from ..body import Body, part_poses, twist_jacobian
from ..body.kinematics import scene_poses
from ..body.motion import Motion
from ..numerics.arrays import Array, Bools
from ..numerics.least_squares import GAUSS_NEWTON, StoppingRule, minimise
from ..shot.settings import MAX_OFFSET
from .outline_evidence.outline_lines import KEY_FRAME_PIECE
from .part_shapes import KeyFramePoses, ShapeEquations, compose, shape_equations
from .rendering.part_geometry import Geometry
from .view_frames import ViewFrames

OFFSET_SIGMA = 0.5 / np.sqrt(3)
"""Prior standard deviation of the offset, frames: that of a uniform distribution over half a frame either way."""
MIN_OFFSET = 0.1
"""Smaller offsets are taken as zero, frames: they hardly matter, and poses between frames cost time."""
MIN_SIGMAS = 2.0
"""With several performers, so are offsets that are fewer posterior standard deviations from zero: where people touch,
the outline of one is taken for another's, so that the offset is less certain than it seems."""
ITERATIONS = 2


@dataclass(frozen=True)
class Offset:
    """An offset of the footage, frames (see `core.shot.settings.Settings`), and its inverse variance as measured."""

    value: float = 0.0
    precision: float = 0.0

    @classmethod
    def likeliest(cls, measured: Iterable[Offset], *, several: bool = False) -> Offset:
        """Combine measurements with the prior; the offset is 0 if the result is small (`MIN_OFFSET`) or, with several
        performers, may be by chance (`MIN_SIGMAS`).
        """
        each = list(measured)
        precision = sum(offset.precision for offset in each) + OFFSET_SIGMA**-2
        value = sum(offset.precision * offset.value for offset in each) / precision
        found = abs(value) >= max(MIN_OFFSET, MIN_SIGMAS * several * precision**-0.5)
        return cls(float(np.clip(value, -MAX_OFFSET, MAX_OFFSET)) if found else 0.0, precision)


def key_frame_offset(
    views: Sequence[ViewFrames],
    geometry: Geometry,
    bodies: Sequence[Body],
    motions: Sequence[Motion],
    *,
    first: int,
    keys: Sequence[int],
    known: Bools,
) -> Offset:
    """Estimate the offset on key frames, together with the shapes of the parts.

    Parameters
    ----------
    views : sequence of ViewFrames
        With foreground images.
    geometry : Geometry
        Shapes of all performers' parts as in their bodies.
    bodies : sequence of Body
    motions : sequence of Motion
        F tracked poses per performer, which show how fast every part moves.
    first : int
        Shot frame of the first pose.
    keys : sequence of int
        Indices of the K poses on which some performer has a key pose of the whole body.
    known : ndarray of bool, shape (K, M)
        Which of the M performers have one there.
    """
    if len(motions[0]) < 4 or not views or not len(keys):
        return Offset()
    posed = [motion[np.asarray(keys)] for motion in motions]
    rates = [_rates(motion, keys) for motion in motions]
    frames = [first + key for key in keys]
    problem = _OffsetProblem(views, geometry, bodies, posed, rates, frames, known[:, geometry.performer])
    result = minimise(
        _OffsetState(0.0, np.zeros((len(geometry.spans), 6))),
        problem.linearise,
        _OffsetState.moved,
        trial_cost=problem.trial_cost,
        damping=GAUSS_NEWTON,
        stopping=StoppingRule(ITERATIONS, relative_gain=0.0),
    )
    try:
        variance = result.linearised().factor().covariance()[-1, -1]
    except np.linalg.LinAlgError:  # nothing moves, or no outline shows it
        return Offset()
    return Offset(result.state.offset, float(1 / (variance * KEY_FRAME_PIECE)))


@dataclass(frozen=True, eq=False)
class _OffsetState:
    """The offset, frames, and the stretches and shifts of all parts, shape (P, 6)."""

    offset: float
    change: Array

    def moved(self, step: Array) -> _OffsetState:
        """Return the state after a step; parts that are ahead of the footage along their twists are early."""
        offset = float(np.clip(self.offset - step[-1], -1.0, 1.0))
        return _OffsetState(offset, compose(self.change, step[:-1]))


@dataclass(frozen=True, eq=False)
class _OffsetProblem:
    """The outlines of K key frames, by which the offset and the shapes of the P parts are estimated.

    Attributes
    ----------
    views, geometry, bodies
        See `key_frame_offset`.
    posed : sequence of Motion
        K poses per performer.
    rates : sequence of ndarray, shape (K, D)
        Increments of these poses per frame.
    frames : sequence of int
        Their shot frames.
    known : ndarray of bool, shape (K, P)
        Which parts are of a performer with a key pose there.
    """

    views: Sequence[ViewFrames]
    geometry: Geometry
    bodies: Sequence[Body]
    posed: Sequence[Motion]
    rates: Sequence[Array]
    frames: Sequence[int]
    known: Bools

    def poses_at(self, offset: float) -> dict[float, list[Motion]]:
        """Return the poses that views show at an offset, by the delay of the views."""
        return {
            delay: [pose.moved((delay - offset) * rate) for pose, rate in zip(self.posed, self.rates, strict=True)]
            for delay in {view.delay for view in self.views}
        }

    def linearise(self, state: _OffsetState) -> ShapeEquations:
        """Return the normal equations at a state."""
        there = self.poses_at(state.offset)
        poses = {d: scene_poses(self.bodies, motions) for d, motions in there.items()}
        twists = {d: _twists(self.bodies, motions, self.rates) for d, motions in there.items()}
        posed = KeyFramePoses(self.frames, poses, self.known, twists)
        return shape_equations(self.views, self.geometry, state.change, posed)

    def trial_cost(self, state: _OffsetState, equations: ShapeEquations) -> float:
        """Return the cost of a state with the outlines held that the equations were made of."""
        poses = {d: scene_poses(self.bodies, motions) for d, motions in self.poses_at(state.offset).items()}
        return equations.cost_at(state.change, poses)


def _rates(motion: Motion, frames: Sequence[int]) -> Array:
    """Increments per frame on some of four or more frames, (K, D), by differences of the frames around. Key poses at
    the ends are left out of these, as they may be offset from their neighbours.
    """
    last = len(motion) - 1
    before = np.clip(np.asarray(frames) - 1, 1, last - 2)
    after = np.clip(np.asarray(frames) + 1, 2, last - 1)
    return np.asarray(motion[before].difference(motion[after]) / (after - before)[:, None])


def _twists(bodies: Sequence[Body], motions: Sequence[Motion], rates: Sequence[Array]) -> Array:
    """Twists of all performers' parts about the world's origin per frame, (K, P, 6)."""
    found = []
    for body, motion, rate in zip(bodies, motions, rates, strict=True):
        J = twist_jacobian(body, *part_poses(body, motion))
        found.append(np.einsum("kpid,kd->kpi", J, rate))
    return np.concatenate(found, axis=1)
