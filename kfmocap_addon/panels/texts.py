"""Texts of any length in panels: broken into lines, not cut off; among them what is said in several sections."""

from __future__ import annotations

import blf
import bpy

from ..operators.footage.recover import ShowHidden
from ..operators.footage.restore_frame_rate import RestoreFrameRate
from ..scene_io import visibility

_BESIDE = 70  # of a line's width: what panels take, in units of the interface
_ICON = 18  # what an icon takes of it
_USUAL_WIDTH = 230  # width of a sidebar where there is none to ask


def draw_text(layout: bpy.types.UILayout, context: bpy.types.Context, text: str, icon: str = "NONE") -> None:
    """Draw a text in as many lines as the sidebar's width asks for; the icon is before the first."""
    column = layout.column(align=True)
    column.scale_y = 0.85
    room = _width(context)
    if icon != "NONE":
        room -= _ICON * (context.preferences.system.ui_scale or 1.0)
    for number, line in enumerate(lines(text, room)):
        column.label(text=line, icon=icon if number == 0 else "BLANK1" if icon != "NONE" else "NONE")


def draw_unit_scale(layout: bpy.types.UILayout, context: bpy.types.Context) -> None:
    """Draw a warning if Blender shows lengths at another scale than in metres to a unit."""
    units = context.scene.unit_settings
    if units.system != "NONE" and abs(units.scale_length - 1.0) > 1e-6:
        text = f"The scene's Unit Scale is {units.scale_length:g}, but a unit is a metre here: set it to 1"
        draw_text(layout, context, text, "ERROR")


def draw_replaced_rate(layout: bpy.types.UILayout, context: bpy.types.Context) -> None:
    """Draw a warning if something has changed the frame rate of the scene's shot, and a button that sets it back."""
    shot = context.scene.kfmocap
    if shot.views and (before := shot.replaced_rate):
        column = layout.column(align=True)
        text = f"The scene has {shot.frame_rate:.5g} frames per second now, its shot has {before:.5g}"
        draw_text(column, context, f"{text}: importing an FBX file changes it", "ERROR")
        column.operator(RestoreFrameRate.bl_idname, text=f"Set Back to {before:.5g}", icon="LOOP_BACK")


def draw_hidden(layout: bpy.types.UILayout, context: bpy.types.Context, thing: bpy.types.Object, what: str) -> None:
    """Draw what cannot be seen because an object is hidden, if it is, and a button that shows it."""
    if visibility.is_hidden(context, thing):
        column = layout.column(align=True)
        draw_text(column, context, f"{what} cannot be seen: '{thing.name}' is hidden", "HIDE_ON")
        column.operator(ShowHidden.bl_idname, icon="HIDE_OFF").hidden = thing.name


def lines(text: str, width: float) -> list[str]:
    """Break a text between its words so that each line is that wide at most, pixels; a longer word has its own."""
    found = [""]
    for word in text.split():
        longer = f"{found[-1]} {word}".strip()
        if found[-1] and _drawn_width(longer) > width:
            found.append(word)
        else:
            found[-1] = longer
    return found


def _drawn_width(text: str) -> float:
    size = bpy.context.preferences.ui_styles[0].widget.points * (bpy.context.preferences.system.ui_scale or 1.0)
    blf.size(0, size)
    return blf.dimensions(0, text)[0]


def _width(context: bpy.types.Context) -> float:
    region = context.region
    scale = context.preferences.system.ui_scale or 1.0
    wide = region.width if region is not None and region.type == "UI" else _USUAL_WIDTH * scale
    return max(wide - _BESIDE * scale, 0.4 * wide)
