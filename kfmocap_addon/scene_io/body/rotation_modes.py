"""Changing bones from Euler angles, or axis and angle, to quaternion rotation."""

from __future__ import annotations

import bpy
import numpy as np
from mathutils import Euler, Quaternion

from ....core.numerics.arrays import Array
from .. import fcurves
from ..fcurves import Keys

_PATHS = ("rotation_euler", "rotation_axis_angle")


def to_quaternions(armature: bpy.types.Object, bones: list[str]) -> list[str]:
    """Change bones to quaternion rotation; their present poses, and those of their keys, stay the same.

    Returns
    -------
    list of str
        Those of the bones that had keys in another mode: these are quaternions now.
    """
    bag, turned = fcurves.find_channelbag(armature), []
    for name in bones:
        bone = armature.pose.bones[name]
        if bone.rotation_mode == "QUATERNION":
            continue
        attribute = _PATHS[bone.rotation_mode == "AXIS_ANGLE"]
        if bag is not None and _turn_keys(bag, bone, attribute):
            turned.append(name)
        bone.rotation_mode = "QUATERNION"
    return turned


def _turn_keys(bag: bpy.types.ActionChannelbag, bone: bpy.types.PoseBone, attribute: str) -> bool:
    """Replace the curves of a bone's rotation by those of its quaternion, with a key wherever there was one."""
    path = bone.path_from_id(attribute)
    curves = [bag.fcurves.find(path, index=i) for i in range(len(getattr(bone, attribute)))]
    keys = [fcurves.get_keys(curve) for curve in curves if curve is not None and len(curve.keyframe_points)]
    if not keys:
        return False
    every: Keys = np.concatenate(keys)
    frames, first = np.unique(every["co"][:, 0], return_index=True)
    values = np.array(
        [
            [
                getattr(bone, attribute)[i] if curve is None else curve.evaluate(float(frame))
                for i, curve in enumerate(curves)
            ]
            for frame in frames
        ]
    )
    quaternions = _quaternions(values, bone.rotation_mode)
    for curve in curves:
        if curve is not None:
            bag.fcurves.remove(curve)
    for i in range(4):
        new = every[first]
        shift = quaternions[:, i] - new["co"][:, 1]
        for field in ("co", "handle_left", "handle_right"):
            new[field][:, 1] += shift
        for side in ("handle_left_type", "handle_right_type"):
            new[side] = fcurves.enum_value(side, "AUTO_CLAMPED")
        curve = fcurves.ensure_fcurve(bag, bone.path_from_id("rotation_quaternion"), i, bone.name)
        fcurves.set_keys(curve, [new])
    return True


def _quaternions(values: Array, mode: str) -> Array:
    """Return the rotations (K, 3) or (K, 4) of a mode as quaternions (K, 4), w first, of signs that are continuous."""
    found: list[Quaternion] = []
    for value in values.tolist():
        turn = Quaternion(value[1:], value[0]) if mode == "AXIS_ANGLE" else Euler(value, mode).to_quaternion()
        if found:
            turn.make_compatible(found[-1])
        found.append(turn)
    return np.array(found)
