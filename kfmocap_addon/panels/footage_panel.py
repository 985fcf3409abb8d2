"""The section "Footage and Cameras": the shot and its views."""

import bpy

from ..operators.cameras.refine_cameras import RefineCameras
from ..operators.footage.add_footage import AddFootage, ImportCalibration, RemoveView, UseSceneCameras
from ..operators.footage.load_shot import LoadShot
from ..operators.footage.look_through import LookThrough, QuadView, StepView
from ..operators.footage.recover import RelinkFootage, RestoreCamera
from ..operators.footage.use_offset import UseOffset
from ..operators.open_section import OpenSection
from .section import FoldedPart, Section, draw_as_form
from .texts import draw_hidden, draw_text


class FootagePanel(Section, bpy.types.Panel):
    bl_idname = "KFMOCAP_PT_footage"
    bl_label = "Footage and Cameras"

    def draw_content(self, context: bpy.types.Context) -> None:
        layout, shot = self.layout, context.scene.kfmocap
        if not shot.views:
            layout.label(text="No footage yet", icon="INFO")
        row = layout.row(align=True)
        row.operator(AddFootage.bl_idname, icon="FILE_MOVIE")
        row.operator(LoadShot.bl_idname, icon="FILE_FOLDER")
        if not shot.views:
            layout.operator(UseSceneCameras.bl_idname, icon="CAMERA_DATA")
            return
        if not all(view.is_calibrated for view in shot.views):
            _draw_calibration(layout, context)
        _draw_problems(layout, context)
        draw_as_form(layout)
        column = layout.column(align=True)
        column.prop(shot, "shot", text="Name")
        column.prop(shot, "frame_rate")
        column.prop(shot, "scene_first")
        column.prop(shot, "scene_last")


def _draw_calibration(layout: bpy.types.UILayout, context: bpy.types.Context) -> None:
    """Draw the ways to calibrated cameras."""
    views = context.scene.kfmocap.views
    layout.label(text="Cameras are not calibrated yet", icon="ERROR")
    column = layout.column(align=True)
    column.operator(ImportCalibration.bl_idname, icon="IMPORT")
    column.operator(UseSceneCameras.bl_idname, icon="CAMERA_DATA")
    button = column.operator(OpenSection.bl_idname, text="Calibrate", icon="CON_CAMERASOLVER")
    button.section, button.alone = "calibration", True
    if len(views) == 1 and views[0].camera is not None:
        _draw_single(layout.column(align=True), context, views[0])


def _draw_problems(layout: bpy.types.UILayout, context: bpy.types.Context) -> None:
    """Draw what is wrong with footage and cameras, with the tools that mend it."""
    views = context.scene.kfmocap.views
    lost = [view.name for view in views if view.missing]
    if lost:
        column = layout.column(align=True)
        for name in lost:
            column.label(text=f"{name}: its footage is missing", icon="ERROR")
        column.operator(RelinkFootage.bl_idname, icon="FILE_REFRESH")
    _draw_lost_cameras(layout, context.scene)
    off = [f"{view.name}: {view.misfit}" for view in views if view.misfit]
    if off:
        column = layout.column(align=True)
        for text in off:
            draw_text(column, context, text, "ERROR")
        _draw_offsets(column, context)
        column.operator(RefineCameras.bl_idname, icon="CON_CAMERASOLVER")
    for view in views:
        if view.faults:
            draw_text(layout, context, f"{view.name}: {view.faults}", "ERROR")


def _draw_offsets(column: bpy.types.UILayout, context: bpy.types.Context) -> None:
    """Draw a button for each view with whose footage another offset fits better."""
    for index, view in enumerate(context.scene.kfmocap.views):
        if view.fitting_offset:
            text = f"Use Offset {view.fitting_offset} for {view.name}"
            column.operator(UseOffset.bl_idname, text=text, icon="TIME").view = index


def _draw_single(column: bpy.types.UILayout, context: bpy.types.Context, view: bpy.types.PropertyGroup) -> None:
    """Draw what a view that is the only one needs instead of a calibration: the performer is posed in front of it,
    wherever it stands.
    """
    text = "Or, as it is one camera: set its lens, turn it until the grid lies on the floor, and tick Calibrated"
    draw_text(column, context, text, "BLANK1")
    column.prop(view.camera.data, "lens", text="Lens", translate=False)
    column.prop(view, "calibrated")


def _draw_lost_cameras(layout: bpy.types.UILayout, scene: bpy.types.Scene) -> None:
    """Draw the views whose camera was deleted, with what brings it back, if it is still in the file, and what removes
    the view.
    """
    for index, view in enumerate(scene.kfmocap.views):
        if not view.has_camera:
            column = layout.column(align=True)
            column.label(text=f"{view.name}: its camera is gone", icon="ERROR")
            row = column.row(align=True)
            if view.can_be_restored:
                row.operator(RestoreCamera.bl_idname).view = index
            row.operator(RemoveView.bl_idname, icon="REMOVE").view = index


class LookPanel(Section, bpy.types.Panel):
    bl_idname = "KFMOCAP_PT_look"
    bl_label = "Look Through"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return bool(context.scene.kfmocap.views)

    def draw_content(self, context: bpy.types.Context) -> None:
        layout, shot = self.layout, context.scene.kfmocap
        shown = shot.shown_view
        column = layout.column(align=True)
        for index, view in enumerate(shot.views):
            icon = "ERROR" if not view.is_calibrated else "VIEW_CAMERA" if index == shown else "CAMERA_DATA"
            column.operator(LookThrough.bl_idname, text=view.name, icon=icon, depress=index == shown).view = index
        if shown >= 0:
            draw_hidden(layout, context, shot.views[shown].camera, "The footage")
        row = layout.row(align=True)
        row.operator(StepView.bl_idname, text="Previous", icon="TRIA_LEFT").step = -1
        row.operator(StepView.bl_idname, text="Next", icon="TRIA_RIGHT").step = 1
        row.operator(QuadView.bl_idname, text="", icon="IMGDISPLAY")
        layout.prop(shot, "opacity", slider=True)
        layout.row().prop(shot, "display", expand=True)
        layout.prop(shot, "show_strip")


class ViewPanel(FoldedPart, bpy.types.Panel):
    bl_idname = "KFMOCAP_PT_view"
    bl_label = "View"
    bl_parent_id = LookPanel.bl_idname

    @classmethod
    def is_needed(cls, context: bpy.types.Context) -> bool:
        return context.scene.kfmocap.shown_view >= 0

    def draw(self, context: bpy.types.Context) -> None:
        layout, shot = self.layout, context.scene.kfmocap
        view = shot.views[shot.shown_view]
        draw_as_form(layout)
        column = layout.column()
        column.prop(view, "name", text="Camera")
        column.prop(view, "offset")
        column.prop(view, "every")
        column.prop(view, "fields")
        column.prop(view, "keypoints")
        column.prop(view, "calibrated")
        if all(other.is_calibrated for other in shot.views):  # else the section above offers it
            column.operator(ImportCalibration.bl_idname, icon="IMPORT")
        column.operator(RemoveView.bl_idname, icon="REMOVE")
        if not any(other.misfit for other in shot.views):  # else the section above offers it
            layout.operator(RefineCameras.bl_idname, icon="CON_CAMERASOLVER")


CLASSES = (FootagePanel, LookPanel, ViewPanel)
