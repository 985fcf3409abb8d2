"""Toes that have a bone each, as those of MakeHuman's people: all bend as the one that plays the role of the toes."""

from __future__ import annotations

from collections.abc import Mapping

import bpy

from ....core.retargeting.bone_roles.roles import SIDES, BoneMap
from ....core.retargeting.control_rig import ControlRig, RigPoses, local_turns
from ...scene_io.body.body_armature import rest_rotations
from ...scene_io.constraints import acts
from .held_bones import turned_by_driver
from .rig_curves import ControlChannel, rotation_channel


def all_toes_bend(armature: bpy.types.Object, bones: BoneMap, shown: Mapping[str, str], side: str) -> bool:
    """Return whether all toes of a foot can be bent: a single bone leads them, or one each which nothing else moves.

    `shown` is the deforming bone, by the control that it follows.
    """
    names = [bones.bones.get(f"{role}.{side}", ("",))[0] for role in ("foot", "toe")]
    foot, toe = (shown.get(name, name) for name in names)
    if not foot or not toe or armature.data.bones[toe].parent is None:
        return False
    others = _beside(armature, foot, toe)
    return not others or (toe == names[1] and all(_is_free(armature, name) for name in others))


def toe_channels(armature: bpy.types.Object, rig: ControlRig, poses: RigPoses) -> list[ControlChannel]:
    """Return the rotations of the bones of toes beside those that are driven: about the same axes, by as much."""
    channels = []
    sides = [side for side in SIDES if f"toe.{side}" in rig.bones.bones and f"foot.{side}" in rig.bones.bones]
    for side in sides:
        toe, foot = (rig.index(f"{role}.{side}") for role in ("toe", "foot"))
        name = rig.rest.names[toe]
        others = [other for other in _beside(armature, rig.rest.names[foot], name) if _is_free(armature, other)]
        if others and poses.driven[toe]:
            turns = local_turns(rig, poses)[:, toe]
            own, *axes = rest_rotations([armature.data.bones[each] for each in (name, *others)])
            for other, its_own in zip(others, axes, strict=True):
                between = own.T @ its_own
                channels.append(rotation_channel(armature.pose.bones[other], between.T @ turns @ between))
    return channels


def _beside(armature: bpy.types.Object, foot: str, toe: str) -> list[str]:
    """Return the bones that hang on the same one as that of a foot's toes and begin, along the foot, nearer to it than
    to the ankle: the little toe's is as far from the big one as half the foot is long. What is farther away than the
    foot is long, such as a knee's pole target, is no toe.
    """
    joint, above = armature.data.bones[toe], armature.data.bones[toe].parent
    if above is None:
        return []
    ankle = armature.data.bones[foot].head_local
    along = joint.head_local - ankle
    others = [bone for bone in above.children if bone != joint]
    near = [bone for bone in others if (bone.head_local - joint.head_local).length < along.length]
    return [bone.name for bone in near if (bone.head_local - ankle).dot(along) > along.length_squared / 2]


def _is_free(armature: bpy.types.Object, name: str) -> bool:
    """Return whether keys can move a bone, and with it some skin."""
    held = any(acts(constraint) for constraint in armature.pose.bones[name].constraints)
    return armature.data.bones[name].use_deform and not held and not turned_by_driver(armature, name)
