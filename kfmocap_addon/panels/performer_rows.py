"""Rows that sections have for each performer."""

from __future__ import annotations

import bpy

from ..operators.performers.choose_performer import ChoosePerformer
from ..scene_io import active_performer


def in_order(context: bpy.types.Context) -> list[bpy.types.PropertyGroup]:
    """Return the performers whose bodies are in the scene, the chosen one first."""
    chosen = active_performer.chosen(context)
    return sorted(active_performer.present(context.scene), key=lambda slot: slot != chosen)


def draw_title(layout: bpy.types.UILayout, context: bpy.types.Context, slot: bpy.types.PropertyGroup) -> None:
    """The performer's name and colour, where there are several; a click chooses it."""
    slots = context.scene.kfmocap.performers
    if len(slots) > 1:
        row = layout.row(align=True)
        draw_choice(row, context, slot, slot.name)
        colour = row.row(align=True)
        colour.ui_units_x = 1.2
        colour.prop(slot, "colour", text="")


def draw_choice(
    layout: bpy.types.UILayout, context: bpy.types.Context, slot: bpy.types.PropertyGroup, text: str
) -> None:
    """The button that chooses a performer, pressed where it is chosen."""
    is_chosen = slot == active_performer.chosen(context)
    icon = "RADIOBUT_ON" if is_chosen else "RADIOBUT_OFF"
    button = layout.operator(ChoosePerformer.bl_idname, text=text, icon=icon, depress=is_chosen)
    button.performer = context.scene.kfmocap.performers.find(slot.name)
