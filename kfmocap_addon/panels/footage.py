"""The section "Footage and Cameras": the shot, and its views to look through."""

import bpy

from ..operators.load_shot import LoadShot
from ..operators.look_through import LookThrough
from ..operators.refine_cameras import RefineCameras
from .section import Section


class FootagePanel(Section, bpy.types.Panel):
    bl_idname = "KFMOCAP_PT_footage"
    bl_label = "Footage and Cameras"

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
        column = layout.column(align=True)
        for index, view in enumerate(properties.views):
            _draw_view(column.row(align=True), index, view, context.scene.camera)
        layout.operator(RefineCameras.bl_idname, icon="CON_CAMERASOLVER")


def _draw_view(
    row: bpy.types.UILayout, index: int, view: bpy.types.PropertyGroup, active: bpy.types.Object | None
) -> None:
    shown = view.camera is not None and view.camera == active
    icon = "VIEW_CAMERA" if shown else "CAMERA_DATA"
    row.operator(LookThrough.bl_idname, text=view.name, icon=icon, depress=shown).view = index
    background = _background(view)
    if background is not None:
        row.prop(background, "alpha", text="Opacity", slider=True)


def _background(view: bpy.types.PropertyGroup) -> bpy.types.CameraBackgroundImage | None:
    images = view.camera.data.background_images if view.camera is not None else ()
    return images[0] if len(images) else None


CLASSES = (FootagePanel,)
