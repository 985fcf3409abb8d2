"""Bars in the timeline and the dope sheet: when heel and ball of the chosen performer's feet are planted."""

from __future__ import annotations

import bpy

from ..scene_io import active_performer
from ..scene_io.body.sides import colour_of
from . import mark_drawing

ROWS = ("heel.L", "ball.L", "heel.R", "ball.R")
"""From above."""
_HEIGHT, _BELOW, _OPACITY = 3, 2, 0.7
"""Pixels: of a bar with the gap to the next, and from the lower edge. The timeline is low by default, and keys are seen
through the bars."""


def draw_bars() -> None:
    """Draw a bar for every plant at the lower edge of the editor that is being drawn."""
    context = bpy.context
    slot = active_performer.chosen(context)
    if slot is None:
        return
    scale = context.preferences.system.ui_scale
    to_region = context.region.view2d.view_to_region
    for plant in slot.plants:
        row = len(ROWS) - 1 - ROWS.index(plant.name)
        left, right = (to_region(frame, 0, clip=False)[0] for frame in (plant.first - 0.5, plant.last + 0.5))
        if right < 0 or left > context.region.width:
            continue
        low = scale * (_BELOW + _HEIGHT * row)
        colour = (*colour_of(plant.name)[:3], _OPACITY)
        mark_drawing.bar((left, low), (right, low + scale * (_HEIGHT - 1)), colour)
