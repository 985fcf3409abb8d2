"""Restore Frame Rate: give the scene back the frame rate of its shot."""

import bpy

from ..conditions import Conditional


def _was_replaced(context: bpy.types.Context) -> str:
    return "" if context.scene.kfmocap.replaced_rate else "The scene has the frame rate of its shot"


class RestoreFrameRate(Conditional, bpy.types.Operator):
    """Give the scene back the frame rate of its shot, which something has changed, such as Blender's FBX import: at
    another rate the motion would be tracked and exported as a slower or faster one. To keep the new rate, enter it in
    Frame Rate"""

    bl_idname = "kfmocap.restore_frame_rate"
    bl_label = "Restore Frame Rate"
    conditions = (_was_replaced,)

    def act(self, context: bpy.types.Context) -> None:
        from ...scene_io.scene import replaced_rate, set_rate

        set_rate(context.scene, replaced_rate(context.scene))


CLASSES = (RestoreFrameRate,)
