"""Use Offset: give a view the offset with which its footage fits the key poses."""

import bpy

from ....core.errors import ShotError
from ..conditions import Conditional, has_views


class UseOffset(Conditional, bpy.types.Operator):
    """Give this view the offset with which its footage fits your key poses better, as tracking has found. Track again
    afterwards"""

    bl_idname = "kfmocap.use_offset"
    bl_label = "Use Offset"
    conditions = (has_views,)

    view: bpy.props.IntProperty(min=0, name="View", description="Number of the view in the shot, from 0")

    def act(self, context: bpy.types.Context) -> None:
        slots = context.scene.kfmocap.views
        if self.view >= len(slots) or not slots[self.view].fitting_offset:
            raise ShotError("No better offset is known of this view")
        slot = slots[self.view]
        slot.offset = float(slot.fitting_offset)
        slot.fitting_offset = slot.misfit = ""


CLASSES = (UseOffset,)
