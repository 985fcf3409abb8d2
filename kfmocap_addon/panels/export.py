"""The section "Export": files for other programs."""

import bpy

from ..operators.export import Export
from .section import Section


class ExportPanel(Section, bpy.types.Panel):
    bl_idname = "KFMOCAP_PT_export"
    bl_label = "Export"

    def draw(self, _context: bpy.types.Context) -> None:
        self.layout.operator(Export.bl_idname, icon="EXPORT")


CLASSES = (ExportPanel,)
