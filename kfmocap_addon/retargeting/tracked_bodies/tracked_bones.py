"""What keeps the bones of an armature from being tracked: refused by name, put right, or remarked on."""

from __future__ import annotations

from collections.abc import Collection

import bpy
import numpy as np

from ....core.errors import BodyError, listed
from ....core.retargeting.bone_roles.roles import BoneMap, parent_role
from ...scene_io import fcurves
from ...scene_io.body import body_armature, body_channels, part_meshes
from ...scene_io.characters.followed_bones import A_DRIVER, leader_of
from ...scene_io.characters.object_motion import what_moves
from ...scene_io.linked import linked_file

_LOWER = ("forearm", "hand", "shin", "foot")
"""Roles of bones that hang on those of the limb above."""
_STILL_TOLERANCE = 1e-5
"""Largest difference between the keys of a channel that does not move, metres for a location: importers round it."""
_OTHER_TURNS, _NAMED = ("rotation_euler", "rotation_axis_angle"), 3
_SCALED = 0.01
"""Least change of a bone's scale that importers' rounding cannot explain."""


def movable_root(armature: bpy.types.Object) -> tuple[str, ...]:
    """Make the root of the body movable; returns remarks on that, and on poses that cannot be tracked.

    What is keyed on bones above it is left to `keyed_on_body`.
    """
    parts = body_armature.body_bones(armature)
    names, remarks = {bone.name for bone in parts}, _keyed_in_vain(armature)
    top = parts[0].name
    if parts[0].use_connect:
        if linked_file(armature.data):
            raise BodyError(
                "it is connected to the bone above, which keeps it from moving, and its armature is linked",
                where=f"armature {armature.name}, bone {top}",
                todo="disconnect it in the character's own file (Alt P in edit mode)",
            )
        with body_armature.edit_bones(armature) as bones:
            bones[top].use_connect = False
        remarks.append(f"bone {top}: it was connected to the bone above, which kept it from moving, and is no longer")
    for bone in armature.pose.bones:
        if bone.name not in names:
            continue
        shifted = bone.name != top and (
            bone.location.length > _still(armature, "location") or moves(armature, bone.name, "location")
        )
        if shifted:
            remarks.append(
                f"bone {bone.name}: its turns alone are tracked: clear its location (Alt G), and the keys of it"
            )
        if np.abs(np.array(bone.scale) - 1).max() > _SCALED or moves(armature, bone.name, "scale", _SCALED):
            remarks.append(f"bone {bone.name}: it is scaled, and the body is not: clear its scale (Alt S) and its keys")
    return tuple(sorted(remarks))


def _keyed_in_vain(armature: bpy.types.Object) -> list[str]:
    """Return what to report of bones of the body whose turns have keys, but in another rotation mode than their own."""
    bag = fcurves.find_channelbag(armature)
    keyed = {curve.data_path for curve in bag.fcurves if len(curve.keyframe_points)} if bag is not None else set()
    own = {c.bone: c.path for c in body_channels.list_channels(armature) if c.attribute == "rotation_quaternion"}
    other = {bone: {fcurves.bone_path(bone, turn) for turn in _OTHER_TURNS} for bone in own}
    bones = [bone for bone, path in own.items() if path not in keyed and other[bone] & keyed]
    if not bones:
        return []
    what = "have keys of another rotation mode than theirs, which move nothing, and are no key poses"
    return [f"bones {listed(bones, _NAMED)}: they {what}: undo, and set the mode back first"]


def moves(armature: bpy.types.Object, bone: str, attribute: str, still: float | None = None) -> bool:
    """Whether keys of a bone's attributes that begin so change anything."""
    bag = fcurves.find_channelbag(armature)
    path = fcurves.bone_path(bone, attribute)
    still = _still(armature, attribute) if still is None else still
    return any(
        curve.data_path.startswith(path) and np.ptp(fcurves.get_keys(curve)["co"][:, 1]) > still
        for curve in (bag.fcurves if bag else ())
    )


def _still(armature: bpy.types.Object, attribute: str) -> float:
    """Return the largest change of an attribute that does not move a bone, in the unit of its channels."""
    return _STILL_TOLERANCE / (max(np.array(armature.matrix_world.to_scale())) if attribute == "location" else 1.0)


def refuse_moving_object(current: bpy.types.Scene, armature: bpy.types.Object) -> None:
    """Raise a BodyError where something moves the armature as a whole."""
    where = f"armature {armature.name}"
    bag = fcurves.find_channelbag(armature)
    for curve in bag.fcurves if bag else ():
        whole = curve.data_path.startswith(("location", "rotation", "scale", "delta_"))
        if whole and np.ptp(fcurves.get_keys(curve)["co"][:, 1]) > _STILL_TOLERANCE:
            raise BodyError(
                f"keys of {curve.data_path} move the armature object itself, and only bones are tracked",
                where=where,
                todo="delete them, and key the topmost bone of the body instead",
            )
    moving = what_moves(current, armature, (current.frame_start, current.frame_end))
    if moving is not None:
        raise BodyError(
            f"{moving} moves the armature object itself, and only bones are tracked",
            where=where,
            todo="free it: clear the parent (Alt P), or mute the constraint",
        )


def refuse_following(armature: bpy.types.Object, parts: tuple[str, ...], followed: dict[str, str]) -> None:
    """Raise a BodyError if something other than its pose moves a part's bone."""
    tied = tied_bones(armature, parts)
    held = [name for name in followed if name in tied]  # those with a constraint of their own come first
    for name in (*held, *tied):
        bone = armature.pose.bones[name]
        if bone.parent is not None and not bone.bone.use_inherit_rotation:
            remove_parts(armature, parts)
            raise BodyError(
                "the bone does not turn with the one above",
                where=f"armature {armature.name}, bone {name}",
                todo="switch Inherit Rotation on in its bone properties, under Relations",
            )
        if name in followed:
            remove_parts(armature, parts)
            leader = leader_of(armature)
            raise BodyError(
                f"the bone is moved by {followed[name]}: it cannot be tracked",
                where=f"armature {armature.name}, bone {name}",
                todo=f"make {leader.name} active instead, which it follows"
                if leader is not None
                else "mute it in the Drivers editor, or delete it, so that the bone is posed itself"
                if followed[name] == A_DRIVER
                else "mute it, so that the bone is posed itself",
            )


def refuse_apart(armature: bpy.types.Object, limbs: BoneMap) -> None:
    """Raise a BodyError where a bone of a human's limb hangs on another bone than those of its limb, as feet do on a
    rig's root: it would not move with the limb.
    """
    for role, names in limbs.bones.items():
        above = limbs.bones.get(parent_role(role, limbs.bones), ())
        if role.partition(".")[0] not in _LOWER or not above:
            continue
        bone = armature.data.bones[names[0]]
        if bone.parent is not None and armature.data.bones[above[-1]] not in bone.parent_recursive:
            raise BodyError(
                f"it hangs on {bone.parent.name} instead of {above[-1]}, and would not move with it",
                where=f"armature {armature.name}, bone {bone.name}",
                todo="give it that parent in edit mode (Ctrl P, Keep Offset)",
            )


def tied_bones(armature: bpy.types.Object, parts: Collection[str]) -> list[str]:
    """Return the bones of parts, and those that are no parts between them."""
    found = set(parts)
    for name in parts:
        above = [bone.name for bone in armature.data.bones[name].parent_recursive]
        hung = next((k for k, other in enumerate(above) if other in parts), 0)
        found |= set(above[:hung])
    return sorted(found)


def remove_parts(armature: bpy.types.Object, parts: tuple[str, ...]) -> None:
    """Remove the meshes of parts, and what was stored on their bones."""
    for name in parts:
        armature.data.bones[name].pop(body_armature.ABOVE, None)
    for name, meshes in part_meshes.meshes_by_bone(armature).items():
        for child in meshes if name in parts else ():
            mesh = child.data
            bpy.data.objects.remove(child)
            bpy.data.meshes.remove(mesh)
