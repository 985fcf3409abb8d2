"""The section "Export": files for other programs."""

import bpy

from ..operators.bake import Bake
from ..operators.export_motion import Export
from ..operators.simplify import Simplify
from .section import Section


class ExportPanel(Section, bpy.types.Panel):
    bl_idname = "KFMOCAP_PT_export"
    bl_label = "Export"

    def draw(self, context: bpy.types.Context) -> None:
        layout, properties = self.layout, context.scene.kfmocap
        settings = properties.export
        layout.use_property_split, layout.use_property_decorate = True, False
        if not properties.performers:
            layout.label(text="No performer yet: add a body, or load a shot", icon="INFO")
        row = layout.row(align=True)
        row.operator(Bake.bl_idname, icon="KEYFRAME_HLT")
        row.operator(Simplify.bl_idname, icon="MOD_SMOOTH")
        layout.prop(settings, "preset")
        row = layout.row(align=True, heading="Files")
        row.prop(settings, "bvh", toggle=True)
        row.prop(settings, "fbx", toggle=True)
        _draw_choice(layout, settings, "use_range", "first", "last")
        _draw_choice(layout, settings, "use_rate", "fps")
        layout.prop(settings, "root_motion")
        layout.operator(Export.bl_idname, icon="EXPORT")


def _draw_choice(layout: bpy.types.UILayout, settings: bpy.types.PropertyGroup, use: str, *names: str) -> None:
    """A checkbox, and what it is about where it is ticked."""
    layout.prop(settings, use)
    if getattr(settings, use):
        row = layout.row(align=True)
        for name in names:
            row.prop(settings, name, text="")


CLASSES = (ExportPanel,)
