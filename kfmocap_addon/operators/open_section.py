"""Sections of the sidebar tab: opened and folded by their titles."""

from typing import Any

import bpy

SECTIONS = (
    ("footage", "Footage and Cameras", "The shot and its cameras"),
    ("look", "Look Through", "The views, and how they are shown"),
    ("calibration", "Calibration", "Cameras from videos of a wand, or from a performer's keypoints"),
    ("body", "Body", "Who is tracked"),
    ("key_poses", "Key Poses", "The poses that tracking meets"),
    ("track", "Track", "The frames between the key poses"),
    ("review", "Review", "How far to trust the result"),
    ("retarget", "Send to Rig", "The motion on another character"),
    ("export", "Export", "Files for other programs"),
)
"""Name, title and description of each section."""


class KFMocapSections(bpy.types.PropertyGroup):
    """Which sections are open: of the window manager, so that undo leaves it alone."""

    shown: bpy.props.EnumProperty(
        items=SECTIONS,
        options={"ENUM_FLAG"},
        default={"footage"},
        name="Open",
        description="Sections that show what they hold",
    )
    step: bpy.props.StringProperty(name="Step", description="The step whose section was opened last by itself")


def register() -> None:
    """Have the window manager know which sections are open."""
    manager: Any = bpy.types.WindowManager
    manager.kfmocap_sections = bpy.props.PointerProperty(type=KFMocapSections)


def unregister() -> None:
    """Have it forget them."""
    manager: Any = bpy.types.WindowManager
    del manager.kfmocap_sections


def sections_of(context: bpy.types.Context) -> Any:
    """Which sections are open, a KFMocapSections."""
    manager: Any = context.window_manager
    return manager.kfmocap_sections


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


CLASSES = (KFMocapSections, OpenSection)
