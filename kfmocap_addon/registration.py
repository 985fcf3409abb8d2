"""What the add-on adds to Blender: classes, the scene's properties, menu entries, drawing handlers.

What is imported here is loaded when Blender starts: it needs neither NumPy nor more of the core than errors, choices
and names of rigs. Operators import the rest when they are used.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import bpy

from . import keymap, panels, properties, toolbar
from .operators import job_operator, open_section, running_tools
from .operators.cameras import (
    calibrate_cameras,
    calibrate_from_performer,
    camera_files,
    capture_views,
    pick_colour,
    refine_cameras,
)
from .operators.characters import export_motion, hand_shape, retarget_bones, send_to_rig
from .operators.footage import add_footage, drop_files, load_shot, look_through, recover, restore_frame_rate, use_offset
from .operators.performers import choose_performer, edit_body, exchange_people, fit_body, hold_prop
from .operators.posing import (
    clear_marks,
    copy_pose,
    nudge_pose,
    place_joints,
    pose_from_files,
    set_key_pose,
    show_key_pictures,
)
from .operators.tracking import bake, go_to_frame, plants, show_residual, simplify, track_motion
from .panels import guide
from .scene_io.cameras import missing_footage
from .session import SESSION
from .untranslated import keep_words
from .viewports import changed_segments, key_list, see_through

OPERATOR_MODULES = (
    open_section,
    load_shot,
    add_footage,
    drop_files,
    recover,
    look_through,
    restore_frame_rate,
    use_offset,
    edit_body,
    hold_prop,
    fit_body,
    refine_cameras,
    set_key_pose,
    show_key_pictures,
    place_joints,
    clear_marks,
    copy_pose,
    nudge_pose,
    pose_from_files,
    exchange_people,
    choose_performer,
    go_to_frame,
    job_operator,
    track_motion,
    show_residual,
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
MODULES = (properties, *OPERATOR_MODULES, *panels.PANEL_MODULES, keymap)
CLASSES = tuple(cls for module in MODULES for cls in module.CLASSES)
MENUS = tuple(entry for module in (edit_body, load_shot, export_motion) for entry in module.MENUS)
"""Names of Blender's menus and what is appended to them."""

_REGISTERING_MODULES = (guide, key_list, changed_segments, missing_footage, see_through, keymap, toolbar)
"""Modules that add more to Blender than classes: handlers, keys, a tool."""

_register_classes, _unregister_classes = bpy.utils.register_classes_factory(CLASSES)


def register() -> None:
    """Add everything to Blender; `unregister` removes it in reverse order."""
    _unwrap_docstrings()
    keep_words(CLASSES)
    _register_classes()
    SESSION.on_end(_unregister_classes)
    properties.register()
    SESSION.on_end(properties.unregister)
    for menu, entry in MENUS:
        getattr(bpy.types, menu).append(entry)
        SESSION.on_end(getattr(bpy.types, menu).remove, entry)
    for module in _REGISTERING_MODULES:
        module.register()
    for space, draw, stage in _OVERLAYS:
        SESSION.on_end(space.draw_handler_remove, space.draw_handler_add(draw, (), "WINDOW", stage), "WINDOW")
    SESSION.on_end(running_tools.cancel_all)


def _unwrap_docstrings() -> None:
    """Put docstrings on one line each: Blender shows those of operators as tooltips, line breaks and all."""
    for cls in CLASSES:
        if cls.__doc__:
            cls.__doc__ = " ".join(cls.__doc__.split())


def unregister() -> None:
    """Remove everything from Blender again."""
    SESSION.end()


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

        strip = key_strip.strip_of(bpy.context)
        if strip is not None:
            key_strip.draw(strip)


def _draw_plants() -> None:
    if bpy.context.scene.kfmocap.show_plants:
        from .overlays import plant_bars

        plant_bars.draw_bars()


_OVERLAYS: tuple[tuple[Any, Callable[[], None], str], ...] = (
    (bpy.types.SpaceView3D, _draw_outlines, "POST_VIEW"),
    (bpy.types.SpaceView3D, _draw_marks, "POST_PIXEL"),
    (bpy.types.SpaceView3D, _draw_strip, "POST_PIXEL"),
    (bpy.types.SpaceDopeSheetEditor, _draw_plants, "POST_PIXEL"),
)
"""Editors that are drawn over: what draws, and when Blender calls it."""
