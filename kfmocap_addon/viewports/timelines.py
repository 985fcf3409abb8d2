"""Timelines and dope sheets that show the keys of the performers, and room for them in Blender's own layout.

Blender lays out areas that were split or joined only when it draws the next time: what follows then waits in a timer.
"""

from __future__ import annotations

from functools import partial
from typing import Any

import bpy

from .screens import NEXT_DRAW, close_area, fit, region_of, split_area, through_camera

_KEY_ROW, _HIGH, _SHARE = 50, 300, 0.02
"""Height of a timeline that shows the keys, below which the 3D view above it gives it some, as little as Blender splits
off, if it is high itself: units of the interface, pixels, and the share that is asked for.
"""


def show_keys(context: bpy.types.Context) -> None:
    """Let timelines and dope sheets, of all workspaces, show the keys of all performers; those of a context's window
    show the whole shot, also where keys are on some of its frames only.

    By default they show those of bones that are selected in pose mode alone: none, after a shot is loaded.
    """
    if context.window is None or context.screen is None:
        return
    context.window.scene.show_keys_from_selected_only = False  # of the timeline
    for screen in bpy.data.screens:
        for area in screen.areas:
            for space in area.spaces:
                if space.type == "DOPESHEET_EDITOR":
                    space.dopesheet.show_only_selected = False
    for area in context.screen.areas:
        if area.type == "DOPESHEET_EDITOR":
            for operator in (bpy.ops.action.view_all, bpy.ops.anim.scene_range_frame):
                fit(context.window, context.screen, area, operator)
            if not bpy.app.background and not _shows_keys(area):
                bpy.app.timers.register(partial(_give_room, context.window, area.as_pointer()), first_interval=0.0)


def _shows_keys(area: bpy.types.Area) -> bool:
    """Whether a timeline is high enough for a row of keys below the bar with the frames; in Blender's own layout it is
    not.
    """
    return region_of(area).height >= _KEY_ROW * (bpy.context.preferences.system.ui_scale or 1.0)


def _area_at(window: bpy.types.Window, pointer: int) -> bpy.types.Area | None:
    """Return the area of a window that has a pointer, if it is still there: a timer must not keep areas themselves."""
    return next((area for area in window.screen.areas if area.as_pointer() == pointer), None)


def _give_room(window: bpy.types.Window, timeline: int) -> None:
    """Split the lowest part off the 3D view above a timeline, which takes it at the next draw."""
    area = _area_at(window, timeline)
    above = view_above(window, area) if area is not None else None
    if above is not None and above.height > _HIGH and split_area(window, above, "HORIZONTAL", _SHARE):
        bpy.app.timers.register(partial(_take_room, window, timeline), first_interval=NEXT_DRAW)


def _take_room(window: bpy.types.Window, timeline: int) -> None:
    area = _area_at(window, timeline)
    split = view_above(window, area) if area is not None else None
    if area is None or split is None or split.height > _HIGH:
        return
    with bpy.context.temp_override(window=window, screen=window.screen, area=area, region=region_of(area)):
        join: Any = bpy.ops.screen.area_join
        middles = [(a.x + a.width // 2, a.y + a.height // 2) for a in (area, split)]
        taken = join.poll() and join(source_xy=middles[0], target_xy=middles[1]) == {"FINISHED"}
    if taken:
        bpy.app.timers.register(partial(_fit_above, window, timeline), first_interval=NEXT_DRAW)
    else:
        close_area(window, split)


def _fit_above(window: bpy.types.Window, timeline: int) -> None:
    """Fit the footage into the 3D view that has given room."""
    area = _area_at(window, timeline)
    view = view_above(window, area) if area is not None else None
    if view is not None and view.spaces.active.region_3d.view_perspective == "CAMERA":
        through_camera(window, window.screen, view)


def view_above(window: bpy.types.Window, area: bpy.types.Area) -> bpy.types.Area | None:
    """Return the 3D view that is as wide as an area and lies directly above it."""
    views = [a for a in window.screen.areas if a.type == "VIEW_3D" and (a.x, a.width) == (area.x, area.width)]
    return min((a for a in views if a.y > area.y), key=lambda a: a.y, default=None)
