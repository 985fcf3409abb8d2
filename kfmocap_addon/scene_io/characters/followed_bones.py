"""Bones that something else than their own pose moves: constraints and drivers, and what they show on frames."""

from __future__ import annotations

from collections.abc import Collection
from typing import Any

import bpy
import numpy as np

from ....core.numerics import rotations
from ....core.numerics.arrays import Array
from ..constraints import acts
from ..fcurves import bone_of
from ..visited_frames import same_time_and_poses

_LIMIT_CONSTRAINTS = ("LIMIT_ROTATION", "LIMIT_LOCATION", "LIMIT_SCALE")
_CHAINS = ("IK", "SPLINE_IK")
"""Constraints that move the bones above as well."""
_FOLLOWING_CONSTRAINTS = ("COPY_TRANSFORMS", "COPY_ROTATION", "CHILD_OF", "ARMATURE")
A_DRIVER = "a driver"
"""What `following` says of bones that drivers move."""
_MOVING = (".location", ".rotation_quaternion", ".rotation_euler", ".rotation_axis_angle", ".scale")


def following(armature: bpy.types.Object) -> dict[str, str]:
    """Return what else than its own pose moves a bone, by the bone; those with a constraint of their own first."""
    data = armature.animation_data
    paths = [driver.data_path for driver in data.drivers if not driver.mute] if data else []
    own = {bone_of(path): A_DRIVER for path in paths if bone_of(path) and path.endswith(_MOVING)}
    found: dict[str, str] = {}
    for bone in armature.pose.bones:
        constraints = list[Any](bone.constraints)
        holds = next((c for c in constraints if acts(c) and c.type not in _LIMIT_CONSTRAINTS), None)
        if holds is not None:
            other = getattr(holds, "target", None)
            whose = f" to {other.name}" if other is not None and other != armature else ""
            own[bone.name] = f"its constraint '{holds.name}'{whose}"
            if holds.type in _CHAINS:
                above = bone.parent_recursive[: holds.chain_count - 1 if holds.chain_count else None]
                found |= {each.name: f"the constraint '{holds.name}' of {bone.name}" for each in above}
    return own | {name: what for name, what in found.items() if name not in own}


def solved_bones(armature: bpy.types.Object) -> set[str]:
    """Return the bones that inverse kinematics pose, at any influence."""
    found = set()
    for bone in armature.pose.bones:
        for held in list[Any](bone.constraints):
            if held.type in _CHAINS and not held.mute:
                found |= {each.name for each in [bone, *bone.parent_recursive][: held.chain_count or None]}
    return found


def skeletons_following(armature: bpy.types.Object) -> dict[bpy.types.Object, dict[str, str]]:
    """Return the other armatures whose bones follow an armature's: the bone that each follows, by its name.

    The skeleton that goes into a game engine, with the character's skin, hangs on a rig of controls like that.
    """
    found = {other: _followed_of(other, armature) for other in bpy.data.objects if other.type == "ARMATURE"}
    return {other: bones for other, bones in found.items() if bones and other != armature}


def leader_of(armature: bpy.types.Object) -> bpy.types.Object | None:
    """Return the armature whose bones an armature's follow, None where they follow none."""
    others = [other for other in bpy.data.objects if other.type == "ARMATURE" and other != armature]
    return next((other for other in others if _followed_of(armature, other)), None)


def _followed_of(follower: bpy.types.Object, armature: bpy.types.Object) -> dict[str, str]:
    """Return the bone of an armature that each bone of another one copies or hangs on, by its name."""
    found = {}
    for bone in follower.pose.bones:
        for held in list[Any](bone.constraints):
            if held.type in _FOLLOWING_CONSTRAINTS and acts(held):
                first = next(iter(held.targets), None) if held.type == "ARMATURE" else held
                if first is not None and first.target == armature and first.subtarget:
                    found[bone.name] = first.subtarget
    return found


def read_followed(
    scene: bpy.types.Scene, armature: bpy.types.Object, bones: Collection[str], times: Array
) -> dict[str, tuple[Array, Array, Array]]:
    """Return what bones do as Blender shows it, as if it were their own pose.

    Parameters
    ----------
    times : ndarray, shape (K,)
        Scene frames, also between whole ones.

    Returns
    -------
    dict of str to tuple of ndarray, shapes (K, 3), (K, 4) and (K, 3)
        Location in the armature's units, quaternion (w, x, y, z) without jumps, and scale, by the bone.
    """
    found = {name: (np.empty((len(times), 3)), np.empty((len(times), 4)), np.empty((len(times), 3))) for name in bones}
    layer = scene.view_layers[0]
    with same_time_and_poses(scene):
        for k, time in enumerate(times):
            whole, part = divmod(float(time), 1.0)
            scene.frame_set(int(whole), subframe=part)
            posed = armature.evaluated_get(layer.depsgraph).pose.bones
            for name, values in found.items():
                for value, shown in zip(values, _own_pose(posed[name]), strict=True):
                    value[k] = shown
    return {name: (place, rotations.continuous_signs(turn), size) for name, (place, turn, size) in found.items()}


def _own_pose(bone: bpy.types.PoseBone) -> tuple[Any, Any, Any]:
    """Location, quaternion and scale with which a bone would stand where it does by its own pose alone."""
    above: dict[str, Any] = {}
    if bone.parent is not None:
        above = {"parent_matrix": bone.parent.matrix, "parent_matrix_local": bone.parent.bone.matrix_local}
    own: Any = bone.bone.convert_local_to_pose(bone.matrix, bone.bone.matrix_local, **above, invert=True)
    return tuple(own.decompose())
