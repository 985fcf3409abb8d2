"""Bake: what the tracker wrote becomes the animator's own."""

import bpy

from . import active_performer
from .reporting import reported


class Bake(bpy.types.Operator):
    """Make tracked keys your own, of the bones selected in pose mode, else of the whole body: from then on no
    tracking replaces them"""

    bl_idname = "kfmocap.bake"
    bl_label = "Bake"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return active_performer.explained(cls, context)

    def execute(self, context: bpy.types.Context) -> set[str]:
        from ..scene_io import keyframes

        with reported(self) as outcome:
            frames = 0
            for armature in active_performer.posed(context):
                frames = max(frames, keyframes.bake(armature, active_performer.chosen_bones(context, armature)))
            if not frames:
                self.report({"WARNING"}, "There are no tracked keys to bake: track first")
                return {"CANCELLED"}
            self.report({"INFO"}, f"Baked {frames} frames")
        return outcome.value


CLASSES = (Bake,)
