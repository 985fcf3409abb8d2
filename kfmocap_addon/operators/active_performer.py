"""Whom a tool is for."""

from __future__ import annotations

import bpy


def chosen(context: bpy.types.Context) -> bpy.types.PropertyGroup | None:
    """The performer whose armature, or a mesh of it, is the active object; else the one chosen by name; else the first.

    None where no performer has an armature in the scene.
    """
    properties = context.scene.kfmocap
    slots = [s for s in properties.performers if s.armature is not None and s.armature.name in context.scene.objects]
    active = context.view_layer.objects.active if context.view_layer is not None else None
    for slot in slots:
        if active is not None and slot.armature in (active, active.parent):
            return slot
    return next((slot for slot in slots if slot.name == properties.performer), slots[0] if slots else None)


def chosen_bones(context: bpy.types.Context, armature: bpy.types.Object) -> set[str] | None:
    """Names of the bones that are selected in pose mode; None, for the whole body, outside it and where none is."""
    if armature.mode != "POSE":
        return None
    return {bone.name for bone in context.selected_pose_bones or [] if bone.id_data == armature} or None


def explained(operator: type[bpy.types.Operator], context: bpy.types.Context) -> bool:
    """Whether there is a performer to pose; if not, the disabled button says so."""
    slot = chosen(context)
    if slot is None:
        operator.poll_message_set("This scene has no performer yet: use Load Shot, or add a body")
    elif slot.armature.mode == "EDIT":
        operator.poll_message_set("The body is being edited: leave edit mode first")
    else:
        return True
    return False


def posed(context: bpy.types.Context) -> list[bpy.types.Object]:
    """Armatures of the performers that are selected or in pose mode; where none is, of the one that is chosen."""
    armatures = [slot.armature for slot in context.scene.kfmocap.performers if slot.armature is not None]
    names = {o.name for o in context.view_layer.objects if o.select_get()}
    found = [a for a in armatures if a.name in context.scene.objects and (a.name in names or a.mode == "POSE")]
    return found or [chosen(context).armature]
