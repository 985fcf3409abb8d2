"""Toes that have a bone each, as those of MakeHuman's people: all bend as the one that plays the role of the toes."""

from __future__ import annotations

from collections.abc import Mapping

import bpy
import numpy as np

from ....core.retargeting.bone_roles.roles import SIDES, BoneMap
from ....core.retargeting.control_rig import ControlRig, RigPoses, local_turns
from ...scene_io.constraints import acts
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
    roles = [side for side in SIDES if f"toe.{side}" in rig.bones.bones and f"foot.{side}" in rig.bones.bones]
    for side in roles:
        toe, foot = (rig.index(f"{role}.{side}") for role in ("toe", "foot"))
        name = rig.rest.names[toe]
        others = [other for other in _beside(armature, rig.rest.names[foot], name) if _is_free(armature, other)]
        if others and poses.driven[toe]:
            turns, own = local_turns(rig, poses)[:, toe], _axes(armature, name)
            for other in others:
                between = own.T @ _axes(armature, other)
                channels.append(rotation_channel(armature.pose.bones[other], between.T @ turns @ between))
    return channels


def _beside(armature: bpy.types.Object, foot: str, toe: str) -> list[str]:
    """Return the bones that begin beside that of a foot's toes, and hang on the same one."""
    joint, above = armature.data.bones[toe], armature.data.bones[toe].parent
    if above is None:
        return []
    near = (joint.head_local - armature.data.bones[foot].head_local).length / 2
    others = [bone for bone in above.children if bone != joint]
    return [bone.name for bone in others if (bone.head_local - joint.head_local).length < near]


def _is_free(armature: bpy.types.Object, name: str) -> bool:
    return armature.data.bones[name].use_deform and not any(acts(c) for c in armature.pose.bones[name].constraints)


def _axes(armature: bpy.types.Object, name: str) -> np.ndarray:
    return np.array(armature.data.bones[name].matrix_local.to_3x3())
