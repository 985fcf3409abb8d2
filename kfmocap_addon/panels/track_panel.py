"""The section "Track": the frames between the key poses."""

import bpy

from ...core.runtime.processes.job import Job
from ..operators.job_operator import draw_progress, running_job
from ..operators.key_conditions import is_tracked_around
from ..operators.tracking.track_motion import (
    ClearBetween,
    ContinueTracking,
    TrackAll,
    TrackBackward,
    TrackChanges,
    TrackForward,
    TrackHere,
)
from ..scene_io import active_performer, unfinished_tracking
from .section import FoldedPart, Section, draw_as_form
from .texts import draw_text


class TrackPanel(Section, bpy.types.Panel):
    bl_idname = "KFMOCAP_PT_track"
    bl_label = "Track"

    def draw_content(self, context: bpy.types.Context) -> None:
        layout, job = self.layout, running_job(context.window)
        properties = context.scene.kfmocap
        if job is not None:
            _draw_running(layout, context, job)
            return
        if len(properties.performers) > 1:
            slot = active_performer.chosen(context)
            layout.row().prop(properties, "tracked", expand=True)
            if properties.tracked == "CHOSEN" and slot is not None:
                layout.label(text=f"Chosen: {slot.name}", icon="ARMATURE_DATA")
        if missing := TrackAll.missing(context):
            draw_text(layout, context, missing, "INFO")
        _draw_tools(layout, context)
        for slot in properties.performers:
            for text in slot.disturbances.splitlines():
                draw_text(layout, context, f"{slot.name}: {text}", "ERROR")
        if properties.footage_offset:
            from ...core.shot.frame_numbers import footage_offset_text  # it loads SciPy

            text = footage_offset_text(properties.footage_offset)
            draw_text(layout, context, text[0].upper() + text[1:], "TIME")


def _draw_running(layout: bpy.types.UILayout, context: bpy.types.Context, job: Job) -> None:
    """Draw the progress of a job, and which footage does not show the key poses."""
    draw_progress(layout, job)
    layout.label(text="Cancel: Esc, or in the status bar", icon="CANCEL")
    for view in context.scene.kfmocap.views:
        if view.misfit:
            draw_text(layout, context, f"{view.name}: {view.misfit}", "ERROR")


def _draw_tools(layout: bpy.types.UILayout, context: bpy.types.Context) -> None:
    """Draw the buttons that track, and those that clear what was tracked."""
    column = layout.column(align=True)
    column.operator(TrackAll.bl_idname, icon="SEQUENCE")
    column.operator(TrackChanges.bl_idname, icon="FILE_REFRESH")
    if count := unfinished_tracking.segment_count(context.scene):
        text = f"Continue ({count} segment{'s' if count > 1 else ''} finished)"
        column.operator(ContinueTracking.bl_idname, text=text, icon="RECOVER_LAST")
    column = layout.column(align=True)
    column.operator(TrackHere.bl_idname, icon="ARROW_LEFTRIGHT")
    row = column.row(align=True)
    row.operator(TrackBackward.bl_idname, text="To the Start", icon="TRACKING_BACKWARDS")
    row.operator(TrackForward.bl_idname, text="To the End", icon="TRACKING_FORWARDS")
    column = layout.column(align=True)
    here = column.row(align=True)
    here.enabled = is_tracked_around(context)
    here.operator(ClearBetween.bl_idname, text="Clear Around This Frame", icon="TRACKING_CLEAR_FORWARDS").where = "HERE"
    column.operator(ClearBetween.bl_idname, text="Clear All Tracked Frames").where = "EVERYWHERE"


class SolverPanel(FoldedPart, bpy.types.Panel):
    bl_idname = "KFMOCAP_PT_solver"
    bl_label = "Advanced"
    bl_parent_id = TrackPanel.bl_idname

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        draw_as_form(layout)
        properties = context.scene.kfmocap
        layout.prop(properties, "solver")
        if len(properties.performers) > 1:
            layout.prop(properties, "contact")


CLASSES = (TrackPanel, SolverPanel)
