"""Opening and folding the sections of the sidebar tab."""

import bpy

from ..properties.section_properties import SECTIONS, sections_of


class OpenSection(bpy.types.Operator):
    """Open or fold this section. Ctrl-click: open it and fold all others"""

    bl_idname = "kfmocap.open_section"
    bl_label = "Open Section"
    bl_options = {"INTERNAL"}

    section: bpy.props.EnumProperty(items=SECTIONS, name="Section", description="The section to open or fold")
    alone: bpy.props.BoolProperty(name="Alone", description="Open it and fold all others")

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        self.alone = self.alone or event.ctrl
        return self.execute(context)

    def execute(self, context: bpy.types.Context) -> set[str]:
        sections = sections_of(context)
        sections.shown = {self.section} if self.alone else sections.shown ^ {self.section}
        for area in context.screen.areas if context.screen is not None else ():
            area.tag_redraw()
        return {"FINISHED"}


CLASSES = (OpenSection,)
