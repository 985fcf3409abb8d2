"""Choose Performer: the performer that is posed, and whose key poses and review are shown first."""

import bpy

from ....core.errors import BodyError
from ...scene_io import active_performer
from ..conditions import Conditional, no_performer
from ..mixin import OfPerformer
from .edit_body import select_only


def _has_body(context: bpy.types.Context) -> str:
    slots = context.scene.kfmocap.performers
    there = any(active_performer.is_present(context.scene, slot) for slot in slots)
    return "" if there else no_performer(context)


class ChoosePerformer(Conditional, OfPerformer, bpy.types.Operator):
    """Pose this performer: its armature becomes the active object, in the mode that the one before was in"""

    bl_idname = "kfmocap.choose_performer"
    bl_label = "Choose Performer"
    conditions = (_has_body,)

    def act(self, context: bpy.types.Context) -> None:
        slot = self.slot(context)
        if not active_performer.is_present(context.scene, slot):
            raise BodyError(f"The body of {slot.name} is gone from the scene: bring it back under Body")
        context.scene.kfmocap.performer = slot.name
        mode = context.mode
        if mode != "OBJECT":
            bpy.ops.object.mode_set(mode="OBJECT")
        select_only(context, slot.armature)
        if mode == "POSE" and slot.armature.visible_get():
            bpy.ops.object.mode_set(mode="POSE")


CLASSES = (ChoosePerformer,)
