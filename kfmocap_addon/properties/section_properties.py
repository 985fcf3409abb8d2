"""The sections of the sidebar tab, and which of them are open."""

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
    """Which sections are open. The window manager keeps it, so that undo leaves it alone."""

    shown: bpy.props.EnumProperty(
        items=SECTIONS,
        options={"ENUM_FLAG"},
        default={"footage"},
        name="Open",
        description="Sections that show what they hold",
    )
    step: bpy.props.StringProperty(name="Step", description="The step whose section was opened last by itself")


def sections_of(context: bpy.types.Context) -> Any:
    """Return which sections are open, a KFMocapSections."""
    manager: Any = context.window_manager
    return manager.kfmocap_sections


CLASSES = (KFMocapSections,)
