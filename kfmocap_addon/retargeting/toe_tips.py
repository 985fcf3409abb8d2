"""How far the feet of a character reach ahead and down: as their bones say, or else their skin."""

from __future__ import annotations

from collections.abc import Mapping

import bpy
import numpy as np

from ...core.numerics.arrays import Array
from ...core.retargeting.rest_alignment import ankle_to_ball, facing, toe_reach
from ...core.retargeting.roles import SIDES, BoneMap
from ..scene_io.body.body_armature import world_frame
from ..scene_io.characters.skins import Skin
from .rigs.rig_at_rest import rest_skeleton

_BONE_SHARE = 0.86
"""Where the foot of a body without toes ends, as a share of the reach of its skin: as on the default body."""
_SAME_PLACE = 0.01
"""Distance of heads of bones that are in the same place, as a share of the length of the shin's bone."""
_BELIEVED = (0.8, 1.25)
"""Range of the reach of a foot's bones, in that which its skin shows, within which they are believed."""


def toe_tips(
    armature: bpy.types.Object, skin: Skin, bones: BoneMap, used: BoneMap, shown: Mapping[str, str]
) -> dict[str, float]:
    """Return the horizontal distance from the ankle to the tips of the toes, metres, by side: of skinned feet, and of
    those whose toes have bones, unless the motion moves these.

    Parameters
    ----------
    armature : bpy.types.Object
    skin : Skin
        Its own.
    bones, used : BoneMap
        All that play a role, and those for which there is motion.
    shown : mapping of str to str
        The deforming bone, by the control that it follows.
    """
    sides = [side for side in SIDES if f"foot.{side}" in used.bones and f"toe.{side}" not in used.bones]
    if not sides:
        return {}
    rest = rest_skeleton(armature)
    forward = facing(rest, bones) @ [0.0, -1.0, 0.0]
    toes = {side: toe_reach(rest, bones, side) for side in sides if f"toe.{side}" in bones.bones}
    told = all(shown_by_tail for _, shown_by_tail in toes.values())  # tails of one side alone are by chance
    found = {}
    for side in sides:
        way = ankle_to_ball(rest, bones, side)
        reach = toes[side][0] if side in toes else 0.0 if way is None else float(np.linalg.norm(way))
        [foot] = bones.bones[f"foot.{side}"]
        ahead = forward if way is None else way / np.linalg.norm(way)
        skinned = _BONE_SHARE * _skin_reach(armature, skin, shown.get(foot, foot), ahead)
        if skinned > 0:
            found[side] = reach if told and _BELIEVED[0] < reach / skinned < _BELIEVED[1] else skinned
        elif side in toes:
            found[side] = reach
    return found


def sole_below_ankle(armature: bpy.types.Object, skin: Skin, bones: BoneMap, shown: Mapping[str, str]) -> float | None:
    """Return how far the skin of the feet reaches below the ankles at rest, metres, or what hangs on their bones where
    there is no such skin; None without either. Parameters as for `toe_tips`.
    """
    feet = [shown.get(name, name) for side in SIDES for name in bones.bones.get(f"foot.{side}", ())]
    depths = [float(-points[:, 2].min()) for foot in feet if len(points := _foot_skin(armature, skin, foot))]
    return max(depths or [depth for foot in feet if (depth := _depth_of_bones(armature, foot)) > 0], default=None)


def _depth_of_bones(armature: bpy.types.Object, foot: str) -> float:
    """Return how far the bones that hang on a foot's bone reach below it at rest, metres."""
    matrix, _ = world_frame(armature)
    ankle = armature.data.bones[foot]
    ends = [end for bone in ankle.children_recursive for end in (bone.head_local, bone.tail_local)]
    ways = (np.array([*ends, ankle.head_local]) - np.array(ankle.head_local)) @ matrix[:3, :3].T
    return float(-ways[:, 2].min())


def _skin_reach(armature: bpy.types.Object, skin: Skin, foot: str, ahead: Array) -> float:
    """Return how far the skin of a foot lies ahead of the ankle at rest, metres; 0 without skin."""
    return float(max(_foot_skin(armature, skin, foot) @ ahead, default=0.0))


def _foot_skin(armature: bpy.types.Object, skin: Skin, foot: str) -> Array:
    """Return the skin of a foot at rest, from the ankle, in the world's axes, shape (V, 3).

    It is led by the foot's bone, by others that begin where this does, such as copies of it, and by what hangs on them.
    """
    matrix, _ = world_frame(armature)
    ankle = armature.data.bones[foot]
    near = _SAME_PLACE * (ankle.parent or ankle).length
    below: set[str] = set()
    for bone in armature.data.bones:  # parents first
        above = bone.parent
        if (above and above.name in below) or (bone.head_local - ankle.head_local).length <= near:
            below.add(bone.name)
    led = np.isin(skin.leaders, [i for i, name in enumerate(skin.names) if name in below])
    return np.asarray((skin.points[led] - np.array(ankle.head_local)) @ matrix[:3, :3].T)
