"""The section "Calibration" of the sidebar tab: videos, balls, solving, and importing and exporting cameras."""

from collections.abc import Iterable
from typing import Any

import bpy

from ..operators.cameras.calibrate_cameras import Calibrate, ShowReport
from ..operators.cameras.calibrate_from_performer import CalibrateFromPerformer, height_owner
from ..operators.cameras.camera_files import ExportCameras, ImportCameras
from ..operators.cameras.capture_views import AddVideos, LoadCapture, RemoveVideos
from ..operators.cameras.pick_colour import PickColour
from ..operators.posing.pose_from_files import ImportKeypoints
from ..scene_io import active_performer
from ..scene_io import capture_scene as captures
from . import guide
from .section import FoldedPart, Section, SectionPart, draw_as_form
from .texts import draw_text, draw_unit_scale


class CaptureViewList(bpy.types.UIList):
    bl_idname = "KFMOCAP_UL_capture_views"

    def draw_item(
        self,
        _context: bpy.types.Context,
        layout: bpy.types.UILayout,
        _data: object,
        item: Any,
        _icon: int,
        _active: object,
        _property: str,
    ) -> None:
        """Draw a camera, and which of its videos are missing."""
        layout.prop(item, "name", text="", emboss=False, icon="CAMERA_DATA")
        missing = [take for take in ("lframe", "wand") if not getattr(item, take)]
        if missing:
            layout.label(text="no L-frame" if missing == ["lframe"] else "no wand", icon="ERROR")


class CalibrationPanel(Section, bpy.types.Panel):
    bl_idname = "KFMOCAP_PT_calibration"
    bl_label = "Calibration"

    def draw_content(self, context: bpy.types.Context) -> None:
        capture = context.scene.kfmocap_capture
        if missing := captures.missing(capture):
            draw_text(self.layout, context, missing, "INFO")
        draw_unit_scale(self.layout, context)
        column = self.layout.column(align=True)
        if len(capture.views) < captures.LEAST_VIEWS:
            column.operator(AddVideos.bl_idname, icon="FILE_MOVIE")
        elif slot := captures.slot_to_pick(capture):
            column.operator(PickColour.bl_idname, icon="EYEDROPPER").slot = slot
        column.operator(Calibrate.bl_idname, icon="CON_CAMERASOLVER")
        column.operator(ShowReport.bl_idname, icon="IMAGE_DATA")
        row = self.layout.row(align=True)
        row.operator(ImportCameras.bl_idname, text="Import", icon="IMPORT")
        row.operator(ExportCameras.bl_idname, text="Export", icon="EXPORT")
        for line in capture.summary.splitlines():
            draw_text(self.layout, context, line)


class CapturePanel(SectionPart, bpy.types.Panel):
    bl_idname = "KFMOCAP_PT_capture"
    bl_label = "Videos"
    bl_parent_id = CalibrationPanel.bl_idname

    def draw(self, context: bpy.types.Context) -> None:
        layout, capture = self.layout, context.scene.kfmocap_capture
        layout.operator(LoadCapture.bl_idname, icon="FILE_FOLDER")
        row = layout.row()
        row.template_list(CaptureViewList.bl_idname, "", capture, "views", capture, "active", rows=3)
        buttons = row.column(align=True)
        buttons.operator(AddVideos.bl_idname, text="", icon="ADD")
        buttons.operator(RemoveVideos.bl_idname, text="", icon="REMOVE")
        if capture.active < len(capture.views):
            _draw_view(layout, capture.views[capture.active])
        draw_as_form(layout)
        layout.prop(capture, "report")


class BallsPanel(SectionPart, bpy.types.Panel):
    bl_idname = "KFMOCAP_PT_balls"
    bl_label = "L-Frame and Wand"
    bl_parent_id = CalibrationPanel.bl_idname

    @classmethod
    def is_needed(cls, context: bpy.types.Context) -> bool:
        """Check whether there are videos; until then, the panels that need no wand are more important."""
        return len(context.scene.kfmocap_capture.views) > 0

    def draw(self, context: bpy.types.Context) -> None:
        layout, capture = self.layout, context.scene.kfmocap_capture
        draw_as_form(layout)
        box = layout.box()
        box.label(text="L-frame: centres of the balls")
        for name in ("corner", "middle", "end", "side"):
            column = box.column(align=True)
            column.use_property_split = False
            column.label(text=capture.bl_rna.properties[name].name, translate=False)
            column.row(align=True).prop(capture, name, text="")
        box.prop(capture, "lframe_diameter", text="Ball Diameter")
        _draw_colour(box, capture, "lframe")
        box = layout.box()
        box.label(text="Wand")
        box.prop(capture, "length")
        box.prop(capture, "wand_diameter", text="Ball Diameter")
        box.prop(capture, "one_colour")
        for slot in captures.wanted_slots(capture)[1:]:
            _draw_colour(box, capture, slot)


class PerformerCalibrationPanel(FoldedPart, bpy.types.Panel):
    bl_idname = "KFMOCAP_PT_performer_calibration"
    bl_label = "Without a Wand"
    bl_parent_id = CalibrationPanel.bl_idname

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        draw_as_form(layout)
        missing = CalibrateFromPerformer.missing(context)
        if missing:
            draw_text(layout, context, missing, "INFO")
        views = context.scene.kfmocap.views
        beside = active_performer.chosen(context) is not None and guide.is_open(context, "key_poses")  # has it too
        if views and not all(view.keypoints for view in views) and not beside:
            layout.operator(ImportKeypoints.bl_idname, icon="IMPORT")
        owner, name = height_owner(context)
        layout.prop(owner, name, text="Height")
        _draw_lenses(layout.column(align=True), views)
        layout.operator(CalibrateFromPerformer.bl_idname, icon="ARMATURE_DATA")
        for line in context.scene.kfmocap_capture.performer_summary.splitlines():
            draw_text(layout, context, line)


def _draw_lenses(column: bpy.types.UILayout, views: Iterable[bpy.types.PropertyGroup]) -> None:
    """Draw for each view whether its lens is known, and the focal length."""
    for view in views:
        if view.camera is None:
            continue
        row = column.row(align=True, heading=f"Lens of {view.name}")
        row.prop(view, "lens_known", text="")
        field = row.row()
        field.enabled = view.lens_known
        field.prop(view.camera.data, "lens", text="")


def _draw_view(layout: bpy.types.UILayout, view: bpy.types.PropertyGroup) -> None:
    column = layout.column(align=True)
    draw_as_form(column)
    column.prop(view, "lframe")
    column.prop(view, "wand")
    for name, heading in (("focal", "Focal Length"), ("offset", "Offset")):
        row = column.row(align=True, heading=heading, translate=False)
        row.prop(view, f"knows_{name}", text="")
        field = row.row()
        field.enabled = getattr(view, f"knows_{name}")
        field.prop(view, name, text="")


def _draw_colour(layout: bpy.types.UILayout, capture: bpy.types.PropertyGroup, slot: str) -> None:
    colour = capture.colour(slot)
    picked = captures.is_picked(colour)
    # A wand of two colours has two of these rows.
    several = slot != "lframe" and not capture.one_colour
    which = f"{slot.capitalize()} Colour" if several else "Colour"
    row = layout.row(align=True)
    if picked:
        swatch = row.row()
        swatch.enabled = False
        swatch.prop(colour, "swatch", text=f"{slot.capitalize()} Ball" if several else which)  # a short one fits
    row.operator(PickColour.bl_idname, text="" if picked else f"Pick {which}", icon="EYEDROPPER").slot = slot


CLASSES = (CaptureViewList, CalibrationPanel, CapturePanel, BallsPanel, PerformerCalibrationPanel)
