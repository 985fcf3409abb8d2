"""What the scene says of props in hands, as panels show it."""

from __future__ import annotations

import bpy


def slot_of(scene: bpy.types.Scene, armature: bpy.types.Object | None) -> bpy.types.PropertyGroup | None:
    """Return the performer whose body an armature is, if it is one of the scene's."""
    return next((slot for slot in scene.kfmocap.performers if armature is not None and slot.armature == armature), None)


def why_unused(scene: bpy.types.Scene, hold: bpy.types.PropertyGroup) -> str:
    """Return what keeps a hold from being used, as a sentence for the user; an empty text where nothing does."""
    shot = scene.kfmocap
    if slot_of(scene, hold.prop) is None:
        return "Not used: choose the prop, which must be a performer"
    if slot_of(scene, hold.holder) is None or hold.holder == hold.prop:
        return "Not used: choose another performer that holds it"
    if hold.bone not in hold.holder.data.bones:
        return "Not used: choose the bone that holds it"
    if hold.first > hold.last:
        return "Not used: the last frame is before the first"
    if hold.first >= shot.frame_start + shot.length or hold.last < shot.frame_start:
        return "Not used: the frames are outside of the shot"
    return ""
