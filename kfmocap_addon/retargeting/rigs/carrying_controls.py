"""Controls that carry deforming bones as their parents, without a constraint."""

from __future__ import annotations

from collections.abc import Collection

import bpy
import numpy as np

from ....core.retargeting.bone_roles.bone_words import read_name
from ....core.retargeting.bone_roles.roles import BoneMap

_SAME_PLACE = 1e-3
"""Largest distance between the heads of a control and of its bone, as a share of the rig's size."""
_CONTROLS = ("control", "fk")


def hung_on_controls(
    armature: bpy.types.Object, bones: BoneMap, held: Collection[str]
) -> tuple[BoneMap, dict[str, str]]:
    """Replace deforming bones of a map that hang on a control of their own by it: the animator poses that one. Returns
    the map, and the controls by bone.

    A control begins where the bone does, and has a shape or is called a control. The hips are not replaced, since what
    carries them may carry other bones, too.

    Parameters
    ----------
    held : collection of str
        Bones that are moved by something other than their own pose.
    """
    rest, found = armature.data.bones, dict[str, str]()
    size = float(np.ptp([bone.head_local for bone in rest], axis=0).max()) or 1.0
    hips = bones.bones.get("hips", ())
    for name in bones.names():
        bone, above = rest[name], rest[name].parent
        if above is None or name in (*hips, *held) or above.name in (*hips, *held):
            continue
        control = armature.pose.bones[above.name].custom_shape or read_name(above.name).kind in _CONTROLS
        apart = (above.head_local - bone.head_local).length
        if control and bone.use_deform and not above.use_deform and apart < _SAME_PLACE * size:
            found[name] = above.name
    roles: dict[str, tuple[str, ...]] = {}
    for role, names in bones.bones.items():  # a control between two bones may have passed for one of the neck
        played = tuple(found.get(name, name) for name in names if name not in found.values())
        roles |= {role: played} if played else {}
    return BoneMap(roles, bones.preset, bones.found_by), found
