"""The sidebar tab "KF Mocap" of the 3D view."""

import bpy

from . import occlusion
from .operators.export import Export
from .operators.go_to_frame import GoToFrame
from .operators.load_shot import LoadShot
from .operators.look_through import LookThrough
from .operators.refine_cameras import RefineCameras
from .operators.set_key_pose import SetKeyPose
from .operators.track import Track


class Section:
    """Where our panels are."""

    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "KF Mocap"


class ShotPanel(Section, bpy.types.Panel):
    bl_idname = "KFMOCAP_PT_shot"
    bl_label = "Shot"

    def draw(self, context: bpy.types.Context) -> None:
        layout, properties = self.layout, context.scene.kfmocap
        layout.operator(LoadShot.bl_idname, icon="FILE_FOLDER")
        if not properties.views:
            return
        layout.use_property_split, layout.use_property_decorate = True, False
        column = layout.column(align=True)
        column.prop(properties, "shot", text="Name")
        column.prop(properties, "first")
        column.prop(properties, "last")
        for performer in properties.performers:
            layout.prop(performer, "armature", text=performer.name)


class ViewsPanel(Section, bpy.types.Panel):
    bl_idname = "KFMOCAP_PT_views"
    bl_label = "Views"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return bool(context.scene.kfmocap.views)

    def draw(self, context: bpy.types.Context) -> None:
        column = self.layout.column(align=True)
        for index, view in enumerate(context.scene.kfmocap.views):
            shown = view.camera is not None and view.camera == context.scene.camera
            row = column.row(align=True)
            button = row.operator(
                LookThrough.bl_idname,
                text=view.name,
                icon="VIEW_CAMERA" if shown else "CAMERA_DATA",
                depress=shown,
            )
            button.view = index
            background = _background(view)
            if background is not None:
                row.prop(background, "alpha", text="Opacity", slider=True)
        self.layout.operator(RefineCameras.bl_idname, icon="CON_CAMERASOLVER")


class TrackPanel(Section, bpy.types.Panel):
    bl_idname = "KFMOCAP_PT_track"
    bl_label = "Track"

    def draw(self, context: bpy.types.Context) -> None:
        self.layout.operator(SetKeyPose.bl_idname, icon="KEY_HLT")
        self.layout.prop(context.scene.kfmocap, "solver", text="")
        self.layout.operator(Track.bl_idname, icon="TRACKING_FORWARDS")


class OcclusionPanel(Section, bpy.types.Panel):
    bl_idname = "KFMOCAP_PT_occlusion"
    bl_label = "Out of Sight"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return any(occlusion.is_tracked(slot.armature) for slot in context.scene.kfmocap.performers)

    def draw(self, context: bpy.types.Context) -> None:
        for slot in context.scene.kfmocap.performers:
            if occlusion.is_tracked(slot.armature):
                column = self.layout.column(align=True)
                _draw_hidden(column, slot, context.scene.frame_current)
                _draw_suggestions(column, slot)


class ExportPanel(Section, bpy.types.Panel):
    bl_idname = "KFMOCAP_PT_export"
    bl_label = "Export"

    def draw(self, _context: bpy.types.Context) -> None:
        self.layout.operator(Export.bl_idname, icon="EXPORT")


def _draw_hidden(column: bpy.types.UILayout, slot: bpy.types.PropertyGroup, frame: int) -> None:
    hidden = occlusion.hidden_parts(slot.armature, frame)
    column.label(text=f"{slot.name}: {'no camera sees' if hidden else 'every part is seen'}")
    for part in hidden:
        column.label(text=part, icon="HIDE_ON")


def _draw_suggestions(column: bpy.types.UILayout, slot: bpy.types.PropertyGroup) -> None:
    if slot.suggestions:
        column.separator()
        column.label(text="A key pose would help at")
    for suggestion in slot.suggestions:
        button = column.operator(GoToFrame.bl_idname, text=f"{suggestion.frame}: {suggestion.name}", icon="KEY_HLT")
        button.frame = suggestion.frame
        first, last = suggestion.hidden
        button.reason = (
            f"Jump there and pose {suggestion.name}: seen on this frame, but by no camera on frames {first} to {last}"
        )


def _background(view: bpy.types.PropertyGroup) -> bpy.types.CameraBackgroundImage | None:
    images = view.camera.data.background_images if view.camera is not None else ()
    return images[0] if len(images) else None
