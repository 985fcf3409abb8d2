"""Heel and ball of the feet, the points of a body that touch the ground, and when they are planted."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..numerics.arrays import Array, Bools
from .body import Body
from .foot_plants import find_plants, with_ends
from .kinematics import Poses

SOLE_POINTS = tuple(f"{point}.{side}" for side in "LR" for point in ("heel", "ball"))
"""Names of the points, in order."""
BALL_SHARE = 0.7
"""Place of the ball of the foot, as a share of the way from the heel to the tip of the big toe."""


@dataclass(frozen=True, eq=False)
class Soles:
    """Points of a body's soles, C of them.

    Attributes
    ----------
    names : tuple of str, length C
        Names from `SOLE_POINTS`.
    parts : ndarray of int, shape (C,)
        The parts that carry the points.
    local : ndarray, shape (C, 3)
        Positions of the points in the frames of these parts, metres.
    leg : float
        Length of thigh and shin, metres.
    """

    names: tuple[str, ...]
    parts: NDArray[np.int64]
    local: Array
    leg: float

    @classmethod
    def of(cls, body: Body) -> Soles | None:
        """Return the soles of a body; None if it has no landmarks on heels and toes."""
        sides = [side for side in "LR" if all(f"{side}{name}" in body.landmarks for name in ("Heel", "BigToe", "Hip"))]
        if not sides:
            return None
        parts, points, legs = [], [], []
        for side in sides:
            part, heel = body.landmarks[f"{side}Heel"]
            _, toe = body.landmarks[f"{side}BigToe"]
            hip, _ = body.landmarks[f"{side}Hip"]
            parts += [part, part]
            points += [heel, heel + BALL_SHARE * (toe - heel)]
            legs.append(float(body.parts[hip].head_world[2] - body.parts[part].head_world[2]))
        names = tuple(name for name in SOLE_POINTS if name[-1] in sides)
        return cls(names, np.array(parts), np.array(points), max(float(np.mean(legs)), 1e-3))

    def world(self, poses: Poses) -> Array:
        """Return the points in the world, metres, shape (F, C, 3)."""
        R, T = poses
        return np.asarray(np.einsum("fcab,cb->fca", R[:, self.parts], self.local) + T[:, self.parts])

    def planted(self, poses: Poses, fps: float) -> Bools:
        """Find on which frames the points are planted, shape (F, C).

        Parameters
        ----------
        poses : tuple of ndarray
            See `core.body.kinematics.Poses`.
        fps : float
        """
        return find_plants(self.world(poses), fps, self.leg).planted

    def with_ends(self, planted: Bools, poses: Poses, fps: float) -> Bools:
        """Return plants (F, C) together with the frames beside them to which the points hardly move; parameters as
        in `planted`.
        """
        points = self.world(poses)
        return with_ends(planted, points, find_plants(points, fps, self.leg).speed, fps)
