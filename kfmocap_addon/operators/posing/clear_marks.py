"""Clear Marks: removing the marks of joints that were clicked."""

from __future__ import annotations

import bpy

from ...scene_io import active_performer, joint_marks
from ...viewports import viewport
from ..conditions import Conditional, has_performer
from ..reporting import NothingToDoError


def _has_marks(context: bpy.types.Context) -> str:
    return "" if len(active_performer.chosen(context).marks) else "No joint is marked"


class ClearMarks(Conditional, bpy.types.Operator):
    """Remove all joints of the chosen performer that were clicked on this frame. Poses stay"""

    bl_idname = "kfmocap.clear_marks"
    bl_label = "Clear Marks"
    conditions = (has_performer, _has_marks)

    def act(self, context: bpy.types.Context) -> None:
        slot, frame = active_performer.chosen(context), context.scene.frame_current
        if not joint_marks.on_frame(slot, frame):
            raise NothingToDoError(f"No joint is marked on frame {frame}")
        joint_marks.put(slot, frame, {})
        viewport.redraw(context)


CLASSES = (ClearMarks,)
