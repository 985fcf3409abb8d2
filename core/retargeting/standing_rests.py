"""Rest poses in which a skeleton does not stand, as in mid-stride: for aligning, its legs hang and its feet are flat.

Both feet of a skeleton that stands or sits are level with each other. Where they are not, thighs and shins are turned
down, each knee forward, and each foot until its sole is level: as the skin shows, or else to the usual slope from the
ankle to the ball. Poses that are found are then expressed relative to the rest pose as it is.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np
from scipy.spatial import ConvexHull, QhullError
from scipy.spatial.transform import Rotation

from ..body.skeleton_motion import RestSkeleton, SkeletonMotion
from ..numerics.arrays import Array
from .bone_roles.roles import SIDES, BoneMap
from .control_rig import ControlRig, RigPoses
from .rest_poses.rest_alignment import direction, facing, knee_axes, shortest_turn, to_ball
from .retarget import Retargeted, way_up

_UP = np.array([0.0, 0.0, 1.0])
_LEVEL = 0.06
"""Greatest difference of the ankles' heights, in lengths of a leg, of feet that are level with each other."""
_ALIKE = np.radians(15)
"""Greatest difference of their slopes."""
_TO_BALL, _TO_TIP = np.radians(-28), np.radians(-17)
"""Slopes from the ankle to the ball, and to the tips of the toes, of a foot that is flat on the ground: those of
`core.body.human`."""
_STEEPEST_SOLE = np.radians(70)
"""Greatest slope of a sole, with the shin turned down."""


def standing_turns(
    rest: RestSkeleton, bones: BoneMap, soles: Mapping[str, Array] = MappingProxyType({})
) -> dict[str, Array]:
    """Return how thighs, shins, feet and toes must be turned from rest to stand, by role, each (3, 3) in the world;
    nothing if the skeleton stands, sits or lies, or has no feet.

    Parameters
    ----------
    rest : RestSkeleton
        Z up.
    bones : BoneMap
    soles : mapping of str to ndarray, shape (V, 3)
        By side, the skin of a foot relative to its ankle, in the world.
    """
    if not all(f"foot.{side}" in bones.bones for side in SIDES) or _feet_level(rest, bones):
        return {}
    rise = way_up(rest, bones)
    if rise[2] < np.linalg.norm(rise[:2]):
        return {}
    F = facing(rest, bones)
    down, left = -_UP, F[:, 0]
    hanging = np.stack([down, left, np.cross(down, left)], axis=1)
    found: dict[str, Array] = {}
    for side in SIDES:
        axes, _ = knee_axes(rest, bones, side)
        thigh = hanging @ axes.T
        shin = shortest_turn(thigh @ direction(rest, bones, f"shin.{side}"), down) @ thigh
        way = shin @ to_ball(rest, bones, side)
        ahead = way * [1.0, 1.0, 0.0] if way @ F[:, 1] < 0 else -F[:, 1]
        ahead = ahead / np.linalg.norm(ahead)
        flat = _TO_BALL if f"toe.{side}" in bones.bones else _TO_TIP
        slope = np.arctan2(way @ _UP, way @ ahead) - flat
        if len(soles.get(side, ())):
            slope = _sole_slope(soles[side] @ shin.T @ np.stack([ahead, _UP], axis=1), slope)
        foot = Rotation.from_rotvec(slope * np.cross(_UP, ahead)).as_matrix() @ shin
        turns = {"thigh": thigh, "shin": shin, "foot": foot, "toe": foot}
        found |= {f"{role}.{side}": turn for role, turn in turns.items() if f"{role}.{side}" in bones.bones}
    return found


def _feet_level(rest: RestSkeleton, bones: BoneMap) -> bool:
    """Whether both ankles are at the same height, and both feet have the same slope."""
    ankles, legs, slopes = [], [], []
    for side in SIDES:
        joints = rest.heads[[rest.indices(bones.bones[f"{role}.{side}"])[0] for role in ("thigh", "shin", "foot")]]
        way = to_ball(rest, bones, side)
        ankles.append(joints[2, 2])
        legs.append(np.linalg.norm(np.diff(joints, axis=0), axis=1).sum())
        slopes.append(np.arctan2(way[2], np.linalg.norm(way[:2])))
    return bool(abs(np.diff(ankles)[0]) <= _LEVEL * np.mean(legs) and abs(np.diff(slopes)[0]) <= _ALIKE)


def _sole_slope(profile: Array, usual: float) -> float:
    """Return the slope of the longest side below a foot that is seen from the side, points (V, 2) ahead and up, among
    those that a sole may have.
    """
    try:
        hull = profile[ConvexHull(profile).vertices]  # counterclockwise: what is below goes ahead
    except (QhullError, ValueError):
        return usual
    sides = np.roll(hull, -1, axis=0) - hull
    slopes, lengths = np.arctan2(sides[:, 1], sides[:, 0]), np.linalg.norm(sides, axis=1)
    lengths[np.abs(slopes) > _STEEPEST_SOLE] = 0.0
    return float(slopes[lengths.argmax()]) if lengths.any() else usual


@dataclass(frozen=True, eq=False)
class StandingRest:
    """Bones at rest as they would stand, and how each has been turned for that, shape (J, 3, 3)."""

    rest: RestSkeleton
    turns: Array


def stood(rest: RestSkeleton, bones: BoneMap, turns: Mapping[str, Array], turn_parents: Sequence[int]) -> StandingRest:
    """Return a skeleton with bones turned as `standing_turns` says; those without a role go along with the bone that
    they are turned by. Its ground is below the feet.

    Parameters
    ----------
    turn_parents : sequence of int
        The bone that turns each, -1 for none.
    """
    own = {j: turn for role, turn in turns.items() for j in rest.indices(bones.bones.get(role, ()))}
    carriers = dict(enumerate(rest.parents)) | _legs(rest, bones)
    R = np.broadcast_to(np.eye(3), (len(rest.names), 3, 3)).copy()
    heads = rest.heads.copy()
    for j, k in enumerate(turn_parents):
        R[j] = own.get(j, R[k] if k >= 0 else R[j])
        if (p := carriers[j]) >= 0:
            heads[j] = heads[p] + R[p] @ (rest.heads[j] - rest.heads[p])
    tails = heads + np.einsum("jab,jb->ja", R, rest.tails - rest.heads)
    ends = [f"{role}.{side}" for side in SIDES for role in ("foot", "toe")]
    feet = rest.indices([name for role in ends for name in bones.bones.get(role, ())])
    low = float(np.nanmin(np.concatenate([heads[feet, 2], tails[feet, 2]])))
    return StandingRest(RestSkeleton(rest.names, rest.parents, heads, tails, low), R)


def _legs(rest: RestSkeleton, bones: BoneMap) -> dict[int, int]:
    """Return the bone of the leg above each one, wherever they hang in the skeleton."""
    found: dict[int, int] = {}
    for side in SIDES:
        names = [name for role in ("thigh", "shin", "foot", "toe") for name in bones.bones.get(f"{role}.{side}", ())]
        leg = rest.indices(names)
        found |= dict(zip(leg[1:], leg, strict=False))
    return found


def standing_source(source: SkeletonMotion, bones: BoneMap) -> SkeletonMotion:
    """Return a motion with the rest pose of a skeleton that stands on its ground; the poses stay what they are."""
    turns = standing_turns(source.rest, bones)
    if not turns:
        return source
    there = stood(source.rest, bones, turns, source.rest.parents)
    up = [0.0, 0.0, source.rest.ground - there.rest.ground]
    rest = replace(there.rest, heads=there.rest.heads + up, tails=there.rest.tails + up, ground=source.rest.ground)
    return replace(source, rest=rest, turns=source.turns @ np.swapaxes(there.turns, -1, -2))


def standing_rig(rig: ControlRig, turns: Mapping[str, Array], sole: float | None) -> tuple[ControlRig, Array]:
    """Return a rig as it would stand, see `standing_turns`, and how each control has been turned for that, (B, 3, 3).

    Parameters
    ----------
    sole : float, optional
        How far the feet, flat on the ground, reach below the ankles; by default as far as their bones do.
    """
    there = stood(rig.rest, rig.bones, turns, rig.turn_parents)
    rest = there.rest
    if sole is not None:
        rest = replace(rest, ground=float(np.mean([rest.heads[rig.index(f"foot.{s}"), 2] for s in SIDES])) - sole)
    return replace(rig, rest=rest, R_world_rest=there.turns @ rig.R_world_rest), there.turns


def as_at_rest(result: Retargeted, turned: Array) -> Retargeted:
    """Return poses of a rig as it would stand relative to the rest pose as it is, given `standing_rig`'s turns."""

    def relative(poses: RigPoses) -> RigPoses:
        return replace(poses, turns=poses.turns @ turned)

    return replace(result, poses=relative(result.poses), by_angles=relative(result.by_angles))
