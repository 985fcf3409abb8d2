"""The performer and the bones that an operator acts on."""

from __future__ import annotations

import bpy


def chosen(context: bpy.types.Context) -> bpy.types.PropertyGroup | None:
    """Find the performer to act on.

    It is the one whose armature, or a mesh of it, is the active object; else the one chosen by name in the panel; else
    the first. None where no performer has an armature in the scene.
    """
    slots = present(context.scene)
    active = context.view_layer.objects.active if context.view_layer is not None else None
    for slot in slots:
        if active is not None and slot.armature in (active, active.parent):
            return slot
    return next((slot for slot in slots if slot.name == context.scene.kfmocap.performer), slots[0] if slots else None)


def present(scene: bpy.types.Scene) -> list[bpy.types.PropertyGroup]:
    """Return the performers whose armatures are in the scene."""
    return [slot for slot in scene.kfmocap.performers if is_present(scene, slot)]


def is_present(scene: bpy.types.Scene, slot: bpy.types.PropertyGroup) -> bool:
    """Whether a performer's armature is in the scene: users may delete it."""
    return slot.armature is not None and slot.armature.name in scene.objects


def chosen_bones(context: bpy.types.Context, armature: bpy.types.Object) -> set[str] | None:
    """Return the names of the bones selected in pose mode; None, for the whole body, if there are none."""
    if armature.mode != "POSE":
        return None
    return {bone.name for bone in context.selected_pose_bones or [] if bone.id_data == armature} or None


def posed_bones(context: bpy.types.Context) -> list[tuple[bpy.types.Object, set[str] | None]]:
    """Return the armatures of performers that are selected or in pose mode, or else the chosen performer's, each with
    its `chosen_bones`.
    """
    armatures = [slot.armature for slot in context.scene.kfmocap.performers if slot.armature is not None]
    names = {o.name for o in context.view_layer.objects if o.select_get()}
    found = [a for a in armatures if a.name in context.scene.objects and (a.name in names or a.mode == "POSE")]
    return [(armature, chosen_bones(context, armature)) for armature in found or [chosen(context).armature]]
