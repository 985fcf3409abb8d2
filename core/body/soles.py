"""Heel and ball of the feet, the points of a body that touch the ground, and when they are planted."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ..numerics.arrays import Array, Bools
from .body import Body
from .foot_plants import MIN_DURATION, find_plants, without_short
from .kinematics import Poses

SOLE_POINTS = tuple(f"{point}.{side}" for side in "LR" for point in ("heel", "ball"))
"""Names of the points, in order."""
BALL_SHARE = 0.7
"""Place of the ball of the foot, as a share of the way from the heel to the tip of the big toe."""

STANDING_SPEED, STANDING_STEP = 0.055, 0.002
"""A point that stands is tracked as moving by less than this, metres per second, and metres from one frame to the next:
it moves by less than 0.05 m/s, and the speeds of points that are held are known to 0.005 m/s."""


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

    def with_balls_at(self, share: float) -> Soles:
        """Return the points with each ball at another share of the way from the heel to the tip of the big toe."""
        balls = np.array([name.startswith("ball") for name in self.names])
        local = self.local.copy()
        heels = local[np.roll(balls, -1)]
        local[balls] = heels + share / BALL_SHARE * (local[balls] - heels)
        return replace(self, local=local)

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

    def standing(self, held: Bools, poses: Poses, fps: float) -> Bools:
        """Return on which frames the points stand, (F, C): those on which the solver holds them, and those next to
        these, as far as the points hardly move. Brief spans (`MIN_DURATION`) do not count. The ball of a foot that
        rolls over a point in front of it begins to move while the foot is still held.

        Parameters
        ----------
        held : ndarray of bool, shape (F, C)
        poses, fps
            See `planted`.
        """
        size = np.linalg.norm(np.diff(self.world(poses), axis=0), axis=2)
        still, kept = size < min(STANDING_SPEED / fps, STANDING_STEP), held[1:] & held[:-1]
        steps = np.pad(kept & still, ((1, 1), (0, 0)))
        steps = (steps[1:-1] | steps[2:] | steps[:-2]) & still
        shortest = int(np.ceil(MIN_DURATION * fps))
        slow = steps | kept & (size < STANDING_STEP)  # as at a key pose that tracking misses by millimetres
        steps = np.stack([without_short(column, shortest, False) for column in steps.T], axis=1) & slow
        steps = np.stack([without_short(column, shortest, True) for column in steps.T], axis=1)
        stands = np.pad(steps, ((1, 1), (0, 0)))
        stands = stands[1:] | stands[:-1]
        stands[1:] &= steps | ~stands[:-1]  # between two plants a point moves
        return np.asarray(stands)
