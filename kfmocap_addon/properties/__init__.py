"""What the add-on keeps beside Blender's own data: of a scene's shot and capture, and of the sidebar's sections."""

from typing import Any

import bpy

from . import (
    capture_properties,
    export_properties,
    performer_properties,
    retarget_properties,
    section_properties,
    shot_properties,
    view_properties,
)

CLASSES = (
    *view_properties.CLASSES,
    *performer_properties.CLASSES,
    *export_properties.CLASSES,
    *retarget_properties.CLASSES,
    *shot_properties.CLASSES,
    *capture_properties.CLASSES,
    *section_properties.CLASSES,
)
"""In the order in which they are registered: a class comes after those that it points to."""
_OWNED: tuple[tuple[Any, str, type], ...] = (
    (bpy.types.Scene, "kfmocap", shot_properties.KFMocapScene),
    (bpy.types.Scene, "kfmocap_capture", capture_properties.KFMocapCapture),
    (bpy.types.WindowManager, "kfmocap_sections", section_properties.KFMocapSections),
)
"""Blender's types, and the property that each gets: its name and class."""


def register() -> None:
    """Give scenes and the window manager their properties, once the classes are registered."""
    for owner, name, kind in _OWNED:
        setattr(owner, name, bpy.props.PointerProperty(type=kind))


def unregister() -> None:
    """Take the properties away again; their values stay in the file."""
    for owner, name, _ in reversed(_OWNED):
        delattr(owner, name)
