"""Where the feet of a motion are, and when they are planted."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from ...body.foot_plants import find_plants, with_ends
from ...body.skeleton_motion import RestSkeleton, SkeletonMotion
from ...body.soles import BALL_SHARE
from ...numerics.arrays import Array, Bools
from ...numerics.frame_ranges import runs
from ..bone_roles.roles import SIDES, BoneMap
from ..rest_poses.rest_alignment import ankle_to_ball, facing, foot_ends_at_ball
from ..transfer import leg_length

HEEL, BALL = 0, 1
"""Indices of a sole's points."""
_HEEL_BACK = 0.3  # of the horizontal distance from ankle to ball: from the ankle back to the heel, if it is unknown
_FOOT_LENGTH = 0.17  # of the leg length: from the ankle to the ball, if it is unknown
_DEEP_TOES = 0.005  # of the leg length: how deep tips of toes may be in the floor before those that can bend do so


@dataclass(frozen=True, eq=False)
class FootPath:
    """One foot of the source.

    Attributes
    ----------
    side : str
    points : ndarray, shape (F, 2, 3)
        Heel and ball on the sole, in the source's world frame and unit. Where the bone of the foot ends at the tips of
        the toes, these are in the ball's place, as the foot rolls over them.
    offsets : ndarray, shape (2, 3)
        The same points relative to the ankle, at rest.
    planted : ndarray of bool, shape (F, 2)
        When each of them is planted.
    floor : float
        Height of planted points, in the source's unit.
    ball : float
        Place of the ball, as a share of the way from the first point to the second: plants are about it.
    """

    side: str
    points: Array
    offsets: Array
    planted: Bools
    floor: float
    ball: float

    @property
    def heel_and_ball(self) -> Array:
        """What plants are about, shape (F, 2, 3)."""
        return _with_ball(self.points, self.ball)

    @property
    def touching(self) -> Array:
        """Place of what touches the floor while the heel is raised, as a share of the way from the first point to the
        second, (F,): from the ball on, where a stiff foot that rolls over it has the tips of its toes in the floor.
        """
        heel, tip = self.points[..., 2].T
        return np.asarray(np.clip((heel - self.floor) / np.maximum(heel - tip, 1e-12), self.ball, 1.0))

    @property
    def rolls_over_ball(self) -> Bools:
        """Whether the foot is planted, (F,), and rolls over its ball meanwhile rather than over the second point."""
        found, touching = np.zeros(len(self.points), bool), self.touching
        for first, last in runs(self.planted.any(axis=1)):
            frames = slice(first, last + 1)
            own = touching[frames][self.planted[frames, BALL]]
            found[frames] = own.size > 0 and own.mean() < (1 + self.ball) / 2
        return found


def foot_paths(
    source: SkeletonMotion,
    of_source: BoneMap,
    deviation: Array | None = None,
    planted: Mapping[str, Bools] | None = None,
) -> list[FootPath]:
    """Return the paths of the source's soles, and when they are planted.

    Parameters
    ----------
    deviation : ndarray, shape (F, J), optional
        Standard deviation of the position of every bone of the source, in its unit.
    planted : mapping of str to ndarray of bool, shape (F,), optional
        When points of the soles are planted, by their names in `core.body.soles.SOLE_POINTS`, where that is known; for
        other points it is detected from the motion.
    """
    given = planted or {}
    leg = leg_length(source.rest, of_source)
    found = []
    for side in SIDES:
        if f"foot.{side}" not in of_source.bones:
            continue
        [ankle] = source.rest.indices(of_source.bones[f"foot.{side}"])
        offsets = sole_offsets(source.rest, of_source, side)
        rolls = offsets is not None and not foot_ends_at_ball(source.rest, of_source, side)
        if offsets is None:
            forward = _FOOT_LENGTH * leg * (facing(source.rest, of_source) @ [0.0, -1.0, 0.0])
            down = np.array([0.0, 0.0, source.rest.ground - source.rest.heads[ankle, 2]])
            offsets = np.stack([down - _HEEL_BACK * forward, down + forward])
        points = source.positions[:, None, ankle] + np.einsum("fij,cj->fci", source.turns[:, ankle], offsets)
        ball = BALL_SHARE if rolls else 1.0
        soles = _with_ball(points, ball)
        doubt = None if deviation is None else np.repeat(deviation[:, ankle, None], 2, axis=1)
        plants = find_plants(soles, source.fps, leg, doubt)
        seen = with_ends(plants.planted, soles, plants.speed, source.fps)
        columns = [given.get(f"{point}.{side}", seen[:, c]) for c, point in enumerate(("heel", "ball"))]
        found.append(FootPath(side, points, offsets, np.stack(columns, axis=1), plants.floor, ball))
    return found


def _with_ball(points: Array, share: float) -> Array:
    """Return points (F, 2, 3) with the second at a share of the way from the first."""
    along = points[:, BALL] - points[:, HEEL]
    return np.stack([points[:, HEEL], points[:, HEEL] + share * along], axis=1)


def sole_offsets(rest: RestSkeleton, bones: BoneMap, side: str) -> Array | None:
    """Return heel and ball on the ground relative to the ankle, at rest, shape (2, 3); None if they are unknown."""
    ahead = ankle_to_ball(rest, bones, side)
    if ahead is None:
        return None
    [j] = rest.indices(bones.bones[f"foot.{side}"])
    down = np.array([0.0, 0.0, rest.ground - rest.heads[j, 2]])
    return np.stack([down - _HEEL_BACK * ahead, down + ahead])


def toes_in_floor(source: SkeletonMotion, of_source: BoneMap, planted: Mapping[str, Bools] | None = None) -> list[str]:
    """Return the sides on which the tips of a stiff foot's toes are in the floor while it rolls over its ball.

    Parameters as for `foot_paths`.
    """
    found = []
    leg = leg_length(source.rest, of_source)
    for path in foot_paths(source, of_source, planted=planted):
        heel, tip = path.points[..., 2].T
        depth = (1 - path.touching) * (heel - tip)
        if depth[path.planted[:, BALL]].max(initial=0.0) > _DEEP_TOES * leg:
            found.append(path.side)
    return found
