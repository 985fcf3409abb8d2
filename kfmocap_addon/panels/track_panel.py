"""The section "Track": the frames between the key poses."""

import bpy

from ..operators.job_operator import draw_progress, running_job
from ..operators.track_motion import (
    ClearBetween,
    ContinueTracking,
    TrackAll,
    TrackBackward,
    TrackChanges,
    TrackForward,
    TrackHere,
)
from ..scene_io import unfinished_tracking
from .section import Section


class TrackPanel(Section, bpy.types.Panel):
    bl_idname = "KFMOCAP_PT_track"
    bl_label = "Track"

    def draw(self, context: bpy.types.Context) -> None:
        layout, job = self.layout, running_job(context.window)
        properties = context.scene.kfmocap
        layout.prop(properties, "solver", text="")
        if job is not None:
            draw_progress(layout, job)
            layout.label(text="Cancel: Esc, or in the status bar", icon="EVENT_ESC")
            return
        column = layout.column(align=True)
        column.operator(TrackAll.bl_idname, icon="SEQUENCE")
        column.operator(TrackChanges.bl_idname, icon="FILE_REFRESH")
        if count := unfinished_tracking.segment_count(context.scene):
            text = f"Continue ({count} segment{'s' if count > 1 else ''} finished)"
            column.operator(ContinueTracking.bl_idname, text=text, icon="RECOVER_LAST")
        row = layout.row(align=True)
        row.operator(TrackBackward.bl_idname, text="Backward", icon="TRACKING_BACKWARDS")
        row.operator(TrackHere.bl_idname, text="Here", icon="ARROW_LEFTRIGHT")
        row.operator(TrackForward.bl_idname, text="Forward", icon="TRACKING_FORWARDS")
        row = layout.row(align=True)
        row.label(text="Clear", icon="TRACKING_CLEAR_FORWARDS")
        row.operator(ClearBetween.bl_idname, text="Here").where = "HERE"
        row.operator(ClearBetween.bl_idname, text="All").where = "EVERYWHERE"
        if properties.footage_offset:
            when = "late" if properties.footage_offset < 0 else "early"
            layout.label(text=f"Key poses {abs(properties.footage_offset):.2f} frames {when}", icon="TIME")


CLASSES = (TrackPanel,)
