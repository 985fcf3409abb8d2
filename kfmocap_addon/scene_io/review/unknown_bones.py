"""Bones of parts that nothing has shown, in the scene: of people who are not wholly in the picture.

Some are held at rest, as neither landmarks nor keypoints show them; a key pose that turns such a bone frees it. Others
no camera has seen either, as last tracked.
"""

from __future__ import annotations

from collections.abc import Collection

import bpy
import numpy as np

from ....core.numerics import rotations
from ....core.shot.shot import KeyPoses
from ..body import body_armature

UNKNOWN = "kfmocap_unknown"
"""Custom property of a pose bone: see `_DESCRIPTION`. Bones without it are known."""
_DESCRIPTION = "No key pose, keypoint or camera shows this part. 1: as last tracked, 2: it is also held at rest"
_UNSEEN, _RESTING = 1, 2
_TURNED = 0.01
"""A key pose that turns a bone farther from rest than this has it posed, radians."""


def mark_resting(armature: bpy.types.Object, names: Collection[str]) -> None:
    """Mark the bones of parts that rest, and no others."""
    for bone in armature.pose.bones:
        _mark(bone, _RESTING if bone.name in names else 0)


def mark_unseen(armature: bpy.types.Object, names: Collection[str]) -> None:
    """Mark the bones of parts that nothing showed as they were tracked, beside those that rest."""
    for bone in armature.pose.bones:
        rests = bone.get(UNKNOWN, 0) == _RESTING and bone.name in names
        _mark(bone, _RESTING if rests else _UNSEEN if bone.name in names else 0)


def unknown_bones(armature: bpy.types.Object) -> list[str]:
    """Return the names of the bones that are marked, in the body's order."""
    bones = [armature.pose.bones[bone.name] for bone in body_armature.body_bones(armature)]
    return [bone.name for bone in bones if bone.get(UNKNOWN, 0)]


def resting_bones(armature: bpy.types.Object, keys: KeyPoses) -> tuple[str, ...]:
    """Return the names of the bones that rest: those so marked that no key pose turns."""
    names = [bone.name for bone in body_armature.body_bones(armature)]
    turned = np.linalg.norm(rotations.log(keys.poses.rotations), axis=-1) > _TURNED
    posed = (turned & keys.fixed_axes.all(axis=-1)).any(axis=0)
    marked = [armature.pose.bones[name].get(UNKNOWN, 0) == _RESTING for name in names]
    return tuple(name for name, rests, is_posed in zip(names, marked, posed, strict=True) if rests and not is_posed)


def _mark(bone: bpy.types.PoseBone, value: int) -> None:
    if value:
        bone[UNKNOWN] = value
        bone.id_properties_ui(UNKNOWN).update(min=0, max=_RESTING, description=_DESCRIPTION)
    elif UNKNOWN in bone:
        del bone[UNKNOWN]
