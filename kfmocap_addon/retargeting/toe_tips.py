"""How far the feet of a character reach ahead and down: as their bones say, or else their skin."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import bpy
import numpy as np
from scipy.spatial import ConvexHull, QhullError

from ...core.body.skeleton_motion import RestSkeleton
from ...core.numerics.arrays import Array
from ...core.retargeting.bone_roles.roles import SIDES, BoneMap
from ...core.retargeting.rest_poses.rest_alignment import ankle_to_ball, facing, toe_reach
from ...core.retargeting.standing_rests import standing_turns, stood
from ..scene_io.body.body_armature import world_frame
from ..scene_io.characters.skins import Skin, read_skin
from .rigs.rig_at_rest import rest_skeleton

_BONE_SHARE = 0.86
"""Where the foot of a body without toes ends, as a share of the reach of its skin: as on the default body."""
_SAME_PLACE = 0.01
"""Distance of heads of bones that are in the same place, as a share of the length of the shin's bone."""
_FLAT = 3
"""Largest number of points that cannot span a solid."""
_BELIEVED = (0.8, 1.25)
"""Range of the reach of a foot's bones, in that which its skin shows, within which they are believed."""


def toe_tips(rest: RestSkeleton, bones: BoneMap, used: BoneMap, skins: Mapping[str, Array]) -> dict[str, float]:
    """Return the horizontal distance from the ankle to the tips of the toes, metres, by side: of skinned feet, and of
    those whose toes have bones, unless the motion moves these.

    Parameters
    ----------
    rest : RestSkeleton
        Standing.
    bones, used : BoneMap
        All that play a role, and those for which there is motion.
    skins : mapping of str to ndarray, shape (V, 3)
        See `standing_feet`.
    """
    sides = [side for side in SIDES if f"foot.{side}" in used.bones and f"toe.{side}" not in used.bones]
    if not sides:
        return {}
    forward = facing(rest, bones) @ [0.0, -1.0, 0.0]
    toes = {side: toe_reach(rest, bones, side) for side in sides if f"toe.{side}" in bones.bones}
    told = all(shown_by_tail for _, shown_by_tail in toes.values())  # tails of one side alone are by chance
    found = {}
    for side in sides:
        way = ankle_to_ball(rest, bones, side)
        reach = toes[side][0] if side in toes else 0.0 if way is None else float(np.linalg.norm(way))
        ahead = forward if way is None else way / np.linalg.norm(way)
        skinned = _BONE_SHARE * float(max(skins[side] @ ahead, default=0.0))
        if skinned > 0:
            found[side] = reach if told and _BELIEVED[0] < reach / skinned < _BELIEVED[1] else skinned
        elif side in toes:
            found[side] = reach
    return found


def stiff_soles(bones: BoneMap, skins: Mapping[str, Array]) -> dict[str, Array]:
    """Return by side the corners of the convex hull of each foot whose toes have no bone, from the ankle, metres,
    shape (V, 3); `skins` as for `toe_tips`.
    """
    found = {}
    for side, points in skins.items():
        if f"toe.{side}" not in bones.bones and len(points) > _FLAT:
            try:
                found[side] = points[ConvexHull(points).vertices]
            except QhullError:  # all in one plane
                found[side] = points
    return found


def sole_below_ankle(
    armature: bpy.types.Object, bones: BoneMap, shown: Mapping[str, str], skins: Mapping[str, Array], turn: Array
) -> float | None:
    """Return how far feet on the ground reach below the ankles, metres: their skin, see `standing_feet`, or what hangs
    on their bones at rest where there is no such skin; None without either.

    `shown` is the deforming bone, by the control that it follows; `turn` as for `standing_feet`.
    """
    depths = [float(-points[:, 2].min()) for points in skins.values() if len(points)]
    feet = [shown.get(name, name) for side in skins for name in bones.bones[f"foot.{side}"]]
    return max(depths or [depth for foot in feet if (depth := _depth_of_bones(armature, foot, turn)) > 0], default=None)


def _depth_of_bones(armature: bpy.types.Object, foot: str, turn: Array) -> float:
    """Return how far the bones that hang on a foot's bone reach below it at rest, metres."""
    matrix, _ = world_frame(armature)
    ankle = armature.data.bones[foot]
    ends = [end for bone in ankle.children_recursive for end in (bone.head_local, bone.tail_local)]
    ways = (np.array([*ends, ankle.head_local]) - np.array(ankle.head_local)) @ (turn @ matrix[:3, :3]).T
    return float(-ways[:, 2].min())


def standing_feet(
    armature: bpy.types.Object, bones: BoneMap, shown: Mapping[str, str], turn: Array
) -> tuple[dict[str, Array], RestSkeleton, dict[str, Array]]:
    """Return how the legs must be turned from rest to stand, see `standing_turns`; the skeleton as it stands; and by
    side the skin of each foot then, from the ankle, in the world's axes, shape (V, 3).

    Parameters
    ----------
    armature : bpy.types.Object
    bones : BoneMap
    shown : mapping of str to str
        The deforming bone, by the control that it follows.
    turn : ndarray, shape (3, 3)
        How the rest pose is turned in the world, such as by a root, see `root_tilt.straight_turn`.
    """
    skin, rest = read_skin(armature), rest_skeleton(armature)
    rest = replace(rest, heads=rest.heads @ turn.T, tails=rest.tails @ turn.T)
    skins = {
        side: _foot_skin(armature, skin, *(_shown(bones, f"{role}.{side}", shown) for role in ("foot", "toe"))) @ turn.T
        for side in SIDES
        if f"foot.{side}" in bones.bones
    }
    turns = standing_turns(rest, bones, skins)
    if not turns:
        return turns, rest, skins
    turned = {side: points @ turns[f"foot.{side}"].T for side, points in skins.items()}
    return turns, stood(rest, bones, turns, rest.parents).rest, turned


def _shown(bones: BoneMap, role: str, shown: Mapping[str, str]) -> list[str]:
    return [shown.get(name, name) for name in bones.bones.get(role, ())]


def _foot_skin(armature: bpy.types.Object, skin: Skin, foot: Sequence[str], toes: Sequence[str]) -> Array:
    """Return what is led by a foot's bone and the toes', by others that begin where these do, such as copies of them,
    and by what hangs on these, from the ankle at rest; in the world's axes, shape (V, 3).
    """
    matrix, _ = world_frame(armature)
    ankle = armature.data.bones[foot[0]]
    near = _SAME_PLACE * (ankle.parent or ankle).length
    starts = [ankle.head_local, *(armature.data.bones[name].head_local for name in toes)]
    below: set[str] = set()
    for bone in armature.data.bones:  # parents first
        above = bone.parent
        if (above and above.name in below) or any((bone.head_local - start).length <= near for start in starts):
            below.add(bone.name)
    led = np.isin(skin.leaders, [i for i, name in enumerate(skin.names) if name in below])
    return np.asarray((skin.points[led] - np.array(ankle.head_local)) @ matrix[:3, :3].T)
