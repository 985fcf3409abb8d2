"""Plants as evidence: while a point of the sole is planted on the ground, it stands still.

The residuals are the displacements of planted points from one frame to the next, and their heights above a floor that
is known. During a descent, points count as planted that seem so in the present motion, and a robust kernel releases
those that move after all. Which of them really stand, and on the floor, is decided at the end (`standing_feet`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ....body import Body
from ....body.joint_blocks import joint_blocks
from ....body.kinematics import Poses, part_poses
from ....body.motion import Motion
from ....body.soles import Soles
from ....numerics import rotations
from ....numerics.arrays import Array, Bools
from ....numerics.banded_blocks import BandedBlocks
from ....numerics.robust_kernels import GemanMcClure, RobustKernel
from .problem import SegmentProblem

PLANT_SPEED_SIGMA = 0.02
"""Standard deviation of the velocity of a planted point along each axis, metres per second: shoes give way and roll,
and a foot is not quite rigid."""
GEMAN_MCCLURE_SCALE = 4.0
"""Residual, in standard deviations, at which the Geman-McClure kernel gives a weight of one quarter."""


@dataclass(frozen=True, eq=False)
class PlantFactor:
    """The planted points of one performer's soles.

    Attributes
    ----------
    soles : Soles
        C points of the soles.
    steps : ndarray of bool, shape (F - 1, C)
        Which points are planted on a frame and on the next.
    sigma : float
        Standard deviation of a displacement between two frames along each axis, metres.
    kernel : RobustKernel
        Applied to the length of a displacement.
    level : float
        Height of the floor, metres.
    level_precision : ndarray, shape (F - 1, C), optional
        Inverse variance of the mean height of a point on the two frames of a step about the floor, 1 / metres^2.
    """

    soles: Soles
    steps: Bools
    sigma: float
    kernel: RobustKernel
    level: float = 0.0
    level_precision: Array | None = None

    @property
    def frames(self) -> Bools:
        """When points are planted, (F, C)."""
        none = np.zeros((1, self.steps.shape[1]), bool)
        return np.concatenate([self.steps, none]) | np.concatenate([none, self.steps])

    @classmethod
    def found(cls, body: Body, motion: Motion, fps: float, soles: Soles | None = None) -> PlantFactor | None:
        """Find the points that seem planted in a motion, the usual ones of the body's soles unless others are given;
        None if there are none, or the body has no soles.
        """
        soles = Soles.of(body) if soles is None else soles
        if soles is None or len(motion) < 3:
            return None
        planted = soles.planted(part_poses(body, motion), fps)
        steps = planted[1:] & planted[:-1]
        return cls(soles, steps, PLANT_SPEED_SIGMA / fps, GemanMcClure(GEMAN_MCCLURE_SCALE)) if steps.any() else None

    def blocks(self, body: Body, poses: Poses) -> BandedBlocks:
        """Build the normal equations around world poses (R, T) of the parts on F frames."""
        length, planted = len(poses[1]), np.flatnonzero(self.steps.any(axis=1))
        if not len(planted):
            return BandedBlocks.zeros(length, body.dof)
        first, end = int(planted[0]), int(planted[-1]) + 2  # of the frames that any plant is about
        if end - first < length:
            precision = None if self.level_precision is None else self.level_precision[first : end - 1]
            some = replace(self, steps=self.steps[first : end - 1], level_precision=precision)
            return some.blocks(body, (poses[0][first:end], poses[1][first:end])).among(length, first)
        points = self.soles.world(poses)
        F, P, C = len(points), len(body), points.shape[1]
        r = np.diff(points, axis=0) / self.sigma
        squared = np.sum(r**2, axis=-1)
        weight = np.where(self.steps, self.kernel.weight(squared), 0.0)
        rows = np.concatenate([np.broadcast_to(np.eye(3), (F, C, 3, 3)), -rotations.skew(points)], axis=-1)
        J = np.concatenate([-rows[:-1], rows[1:]], axis=-1) / self.sigma
        weighted = np.swapaxes(J, -1, -2) * weight[..., None, None]
        H, g = weighted @ J, (weighted @ r[..., None])[..., 0]
        energy = float(np.sum(np.where(self.steps, self.kernel.cost(squared), 0.0)))
        if self.level_precision is not None:
            above = (points[:-1, :, 2] + points[1:, :, 2]) / 2 - self.level
            up = np.concatenate([rows[:-1, :, 2], rows[1:, :, 2]], axis=-1) / 2
            weighted_up = self.level_precision[..., None] * up
            H += weighted_up[..., :, None] * up[..., None, :]
            g += weighted_up * above[..., None]
            energy += float(np.sum(self.level_precision * above**2))
        carrier = (self.soles.parts == np.arange(P)[:, None]).astype(float)
        return joint_blocks(
            body, poses, np.einsum("pc,fcab->fpab", carrier, H), np.einsum("pc,fca->fpa", carrier, g), energy
        )


def plants_of(problem: SegmentProblem, motions: Sequence[Motion]) -> list[PlantFactor | None]:
    """Find the plants in every performer's motion; None for each where the settings switch plants off."""
    if not problem.settings.plants:
        return [None] * len(motions)
    return [PlantFactor.found(body, motion, problem.fps) for body, motion in zip(problem.bodies, motions, strict=True)]


def with_plants(
    systems: Sequence[BandedBlocks],
    plants: Sequence[PlantFactor | None],
    bodies: Sequence[Body],
    motions: Sequence[Motion],
) -> list[BandedBlocks]:
    """Add plants to the normal equations of every performer.

    Parameters
    ----------
    systems : sequence of BandedBlocks
        Per performer.
    plants : sequence of (PlantFactor or None)
        Per performer; None for no plants.
    bodies : sequence of Body
    motions : sequence of Motion
        The motions at which the equations are built.
    """
    return [
        system if plant is None else plant.blocks(body, part_poses(body, motion)).add(system)
        for system, plant, body, motion in zip(systems, plants, bodies, motions, strict=True)
    ]
