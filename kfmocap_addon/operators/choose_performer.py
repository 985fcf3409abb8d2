"""Choose Performer: the performer that is posed, and whose key poses and review are shown first."""

import bpy

from ..scene_io import active_performer
from .conditions import Conditional
from .edit_body import select_only


def _has_body(context: bpy.types.Context) -> str:
    slots = context.scene.kfmocap.performers
    there = any(active_performer.is_present(context.scene, slot) for slot in slots)
    return "" if there else "This scene has no performer yet: use Load Shot, or add a body"


class ChoosePerformer(Conditional, bpy.types.Operator):
    """Pose this performer: its armature becomes the active object, in the mode that the one before was in"""

    bl_idname = "kfmocap.choose_performer"
    bl_label = "Choose Performer"
    conditions = (_has_body,)

    performer: bpy.props.IntProperty(min=0, name="Performer", description="Number of the performer, from 0")

    def execute(self, context: bpy.types.Context) -> set[str]:
        properties = context.scene.kfmocap
        if self.performer >= len(properties.performers):
            self.report({"ERROR"}, f"The shot has no performer {self.performer}")
            return {"CANCELLED"}
        slot = properties.performers[self.performer]
        if not active_performer.is_present(context.scene, slot):
            self.report({"ERROR"}, f"The body of {slot.name} is gone from the scene: bring it back under Body")
            return {"CANCELLED"}
        properties.performer = slot.name
        mode = context.mode
        if mode != "OBJECT":
            bpy.ops.object.mode_set(mode="OBJECT")
        select_only(context, slot.armature)
        if mode == "POSE" and slot.armature.visible_get():
            bpy.ops.object.mode_set(mode="POSE")
        return {"FINISHED"}


CLASSES = (ChoosePerformer,)
