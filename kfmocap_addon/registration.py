"""What the add-on adds to Blender: classes, the scene's properties, menu entries, drawing handlers.

What is imported here is loaded when Blender starts: it needs neither NumPy nor the core beyond its errors. Operators
import the rest when they are used.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import bpy

from . import keymap, panels, properties, toolbar
from .operators import (
    add_footage,
    bake,
    calibrate_cameras,
    calibrate_from_performer,
    camera_files,
    capture_views,
    choose_performer,
    copy_pose,
    drop_files,
    edit_body,
    exchange_people,
    export_motion,
    fit_body,
    go_to_frame,
    hand_shape,
    hold_prop,
    job_operator,
    load_shot,
    look_through,
    nudge_pose,
    open_section,
    pick_colour,
    place_joints,
    plants,
    pose_from_files,
    recover,
    refine_cameras,
    retarget_bones,
    send_to_rig,
    set_key_pose,
    show_key_pictures,
    show_misfit,
    simplify,
    track_motion,
)
from .panels import guide, key_list
from .properties.shot_properties import KFMocapScene
from .scene_io import capture_scene, missing_footage
from .scene_io.key_pictures import PICTURES

OPERATORS = (
    open_section,
    load_shot,
    add_footage,
    drop_files,
    recover,
    look_through,
    edit_body,
    hold_prop,
    fit_body,
    refine_cameras,
    set_key_pose,
    show_key_pictures,
    place_joints,
    copy_pose,
    nudge_pose,
    pose_from_files,
    exchange_people,
    choose_performer,
    go_to_frame,
    job_operator,
    track_motion,
    show_misfit,
    plants,
    bake,
    simplify,
    export_motion,
    retarget_bones,
    send_to_rig,
    hand_shape,
    camera_files,
    capture_views,
    pick_colour,
    calibrate_cameras,
    calibrate_from_performer,
)
MODULES = (properties, capture_scene, *OPERATORS, *panels.SECTIONS, keymap)
CLASSES = tuple(cls for module in MODULES for cls in module.CLASSES)
MENUS = tuple(entry for module in (edit_body, load_shot, export_motion) for entry in module.MENUS)
"""Names of Blender's menus and what is appended to them."""

_register_classes, _unregister_classes = bpy.utils.register_classes_factory(CLASSES)
_drawings: list[tuple[Any, object]] = []
"""Kinds of editors that are drawn in, with Blender's handles of the drawing functions: to remove these again."""


def register() -> None:
    """Add everything to Blender."""
    _register_classes()
    bpy.types.Scene.kfmocap = bpy.props.PointerProperty(type=KFMocapScene)
    open_section.register()
    bpy.types.Scene.kfmocap_capture = bpy.props.PointerProperty(type=capture_scene.KFMocapCapture)
    for menu, entry in MENUS:
        getattr(bpy.types, menu).append(entry)
    key_list.register()
    missing_footage.register()
    keymap.register()
    toolbar.register()
    view, sheet = bpy.types.SpaceView3D, bpy.types.SpaceDopeSheetEditor
    _drawings.append((view, view.draw_handler_add(_draw_outlines, (), "WINDOW", "POST_VIEW")))
    _drawings.append((view, view.draw_handler_add(_draw_marks, (), "WINDOW", "POST_PIXEL")))
    _drawings.append((view, view.draw_handler_add(_draw_strip, (), "WINDOW", "POST_PIXEL")))
    _drawings.append((sheet, sheet.draw_handler_add(_draw_plants, (), "WINDOW", "POST_PIXEL")))


def unregister() -> None:
    """Remove everything from Blender again."""
    for menu, entry in MENUS:
        getattr(bpy.types, menu).remove(entry)
    toolbar.unregister()
    keymap.unregister()
    missing_footage.unregister()
    key_list.unregister()
    job_operator.unregister()
    while _drawings:
        space, handle = _drawings.pop()
        space.draw_handler_remove(handle, "WINDOW")
    guide.unregister()
    PICTURES.clear()
    open_section.unregister()
    del bpy.types.Scene.kfmocap_capture
    del bpy.types.Scene.kfmocap
    _unregister_classes()


def is_registered() -> bool:
    """Whether scenes have the add-on's properties."""
    return hasattr(bpy.types.Scene, "kfmocap")


@contextmanager
def registered() -> Iterator[None]:
    """Register the add-on while the block runs, where it is not registered already."""
    if is_registered():
        yield
        return
    register()
    try:
        yield
    finally:
        unregister()


def _draw_outlines() -> None:
    if bpy.context.scene.kfmocap.display == "OUTLINE":
        from .overlays import model_outlines

        model_outlines.draw_outlines()


def _draw_marks() -> None:
    from .overlays import mark_drawing

    mark_drawing.draw_marks()


def _draw_strip() -> None:
    if bpy.context.scene.kfmocap.show_strip:
        from .overlays import key_strip

        strip = key_list.strip_of(bpy.context)
        if strip is not None:
            key_strip.draw(strip)


def _draw_plants() -> None:
    if bpy.context.scene.kfmocap.show_plants:
        from .overlays import plant_bars

        plant_bars.draw_bars()
