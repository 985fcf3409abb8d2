"""The section "Export": files for other programs."""

from pathlib import Path

import bpy

from ..export.export_formats import EXPORT_FORMATS
from ..operators.characters.export_motion import Export, OpenExportFolder
from ..operators.tracking.bake import Bake
from ..operators.tracking.simplify import Simplify
from ..scene_io.review import bone_visibility
from .section import Section, draw_as_form
from .texts import draw_text


class ExportPanel(Section, bpy.types.Panel):
    bl_idname = "KFMOCAP_PT_export"
    bl_label = "Export"

    def draw_content(self, context: bpy.types.Context) -> None:
        layout, properties = self.layout, context.scene.kfmocap
        settings = properties.export
        draw_as_form(layout)
        if not properties.performers:
            draw_text(layout, context, "No performer yet: add a body, or load a shot", "INFO")
        waiting = [slot.name for slot in properties.performers if not bone_visibility.is_tracked(slot.armature)]
        if waiting:
            draw_text(layout, context, f"Not tracked yet: {', '.join(waiting)}. Files have the key poses alone", "INFO")
        row = layout.row(align=True)
        row.operator(Bake.bl_idname, icon="KEYFRAME_HLT")
        row.operator(Simplify.bl_idname, icon="MOD_SMOOTH")
        if properties.retarget.target is not None:
            layout.row().prop(settings, "whom", expand=True)
        layout.prop(settings, "preset")
        row = layout.row(align=True)
        row.use_property_split = False  # the names need the whole width
        for name in EXPORT_FORMATS:
            row.prop(settings, name, toggle=True)
        _draw_choice(layout, settings, "use_range", "first", "last")
        _draw_choice(layout, settings, "use_rate", "fps")
        layout.prop(settings, "root_motion")
        layout.prop(settings, "leave_out_unknown")
        layout.operator(Export.bl_idname, icon="EXPORT")
        if settings.written:
            _draw_written(layout, [Path(line) for line in settings.written.splitlines()])


def _draw_written(layout: bpy.types.UILayout, files: list[Path]) -> None:
    """Draw the files that were written last."""
    column = layout.column(align=True)
    for file in files:
        column.label(text=file.name, icon="CHECKMARK")
    column.operator(OpenExportFolder.bl_idname, icon="FILE_FOLDER")


def _draw_choice(layout: bpy.types.UILayout, settings: bpy.types.PropertyGroup, use: str, *names: str) -> None:
    """Draw a checkbox and, if it is ticked, the settings that belong to it."""
    layout.prop(settings, use)
    if getattr(settings, use):
        row = layout.row(align=True)
        for name in names:
            row.prop(settings, name, text="")


CLASSES = (ExportPanel,)
