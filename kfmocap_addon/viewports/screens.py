"""3D views of a window that look through the cameras of views: one, or up to four side by side.

Blender lays out areas that were split or closed only when it draws the next time: what follows then waits in a timer.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import partial
from typing import Any, Literal

import bpy

from .performer_boxes import WHOLE, Part, part_with_performers
from .see_through import see_through_skins

Box = tuple[int, int, int, int]
"""Left, bottom, right and top, pixels of the window."""
MAX_VIEWS = 4
"""Largest number of views shown at once."""
SIDEBAR_TAB = "KF Mocap"
"""Name of the tab of the sidebar that holds all panels."""
NEXT_DRAW = 0.05  # seconds
_FILLING = 50 * (2 - math.sqrt(2))
"""Blender's zoom at which the picture fills the region except for a thin border."""
_MAX_MAGNIFICATION = 4.0
_BESIDE_FOOTAGE = (
    *("show_floor", "show_axis_x", "show_axis_y", "show_axis_z", "show_cursor", "show_text", "show_extras"),
    *("show_bones", "show_motion_paths", "show_object_origins", "show_relationship_lines", "show_outline_selected"),
)
"""Overlays that stay off where only the footage is switched on."""
_SAME_SIZE, _SAME_PLACE = 0.03, 0.01
"""How far a view's size and offset may differ from those that `framing` gave it, as shares of the size and of the
region."""


def look(context: bpy.types.Context) -> None:
    """Let the 3D view of a context look through the scene's camera, with the whole picture in sight.

    If it is one of several views that each look through a camera of their own, it does so still, and the others stay as
    they are.
    """
    area = view3d_of(context)
    if area is None or context.window is None or context.scene.camera is None:
        return
    several = layout_of(context.window)
    space = area.spaces.active
    if area in several and len(several) > 1:
        space.camera = context.scene.camera
    else:
        space.use_local_camera = False
    through_camera(context.window, context.screen, area)


def show_footage() -> None:
    """Let 3D views of all workspaces that look through a camera without overlays, as that of Blender's own Animation
    workspace does, show the footage behind it: Blender counts that among the overlays. All others stay off.
    """
    for screen in bpy.data.screens:
        for space in (area.spaces.active for area in screen.areas if area.type == "VIEW_3D"):
            if space.region_3d.view_perspective == "CAMERA" and not space.overlay.show_overlays:
                space.overlay.show_overlays = True
                for name in _BESIDE_FOOTAGE:
                    setattr(space.overlay, name, False)


def keep_clear(context: bpy.types.Context) -> None:
    """Move the footage of a 3D view clear of our sidebar once that is opened, in a timer: panels cannot change the view
    while they are drawn. Views that the user has zoomed or moved stay as they are.
    """
    if bpy.app.background or context.area is None or _uncovered(context.window.scene, context.area) is None:
        return
    if not bpy.app.timers.is_registered(_clear):
        bpy.app.timers.register(_clear, first_interval=0.0)


def _clear() -> None:
    for window in bpy.context.window_manager.windows:
        for area in window.screen.areas:
            found = _uncovered(window.scene, area) if area.type == "VIEW_3D" else None
            if found is not None:
                region_3d = area.spaces.active.region_3d
                region_3d.view_camera_zoom, region_3d.view_camera_offset = found
                area.tag_redraw()


def _uncovered(scene: bpy.types.Scene, area: bpy.types.Area) -> tuple[float, tuple[float, float]] | None:
    """Return the zoom and offset that move a 3D view's footage clear of our sidebar; None if nothing is to change."""
    space = area.spaces.active
    camera = space.camera if space.use_local_camera else scene.camera
    if space.region_3d.view_perspective != "CAMERA" or camera not in {view.camera for view in scene.kfmocap.views}:
        return None
    if _tab(area) != SIDEBAR_TAB:
        return None
    boxes = uncovered_part(area, "UI"), uncovered_part(area)
    now = space.region_3d.view_camera_zoom, tuple(space.region_3d.view_camera_offset)
    return moved_clear(_box(region_of(area)), boxes, _aspect(scene), now)


def moved_clear(
    region: Box, free: tuple[Box, Box], aspect: float, now: tuple[float, tuple[float, ...]]
) -> tuple[float, tuple[float, float]] | None:
    """Return the zoom and offset that fit a view into the second of two free boxes, if it was fitted into the first by
    `framing`; None if it was not, or the boxes are the same.
    """
    if free[0] == free[1]:
        return None
    zoom, offset = framing(region, free[0], aspect, _FILLING)
    size = (math.sqrt(2) + now[0] / 50) ** 2 / (math.sqrt(2) + zoom / 50) ** 2
    if abs(size - 1) > _SAME_SIZE or any(abs(a - b) > _SAME_PLACE for a, b in zip(now[1], offset, strict=True)):
        return None
    return framing(region, free[1], aspect, _FILLING)


def _aspect(scene: bpy.types.Scene) -> float:
    """Width of a scene's picture by its height."""
    render = scene.render
    return float(render.resolution_x * render.pixel_aspect_x / (render.resolution_y * render.pixel_aspect_y))


def view3d_of(context: bpy.types.Context) -> bpy.types.Area | None:
    """Return the 3D view that the context is in, else the largest of its window."""
    if context.area is not None and context.area.type == "VIEW_3D":
        return context.area
    areas = [a for a in context.screen.areas if a.type == "VIEW_3D"] if context.screen is not None else []
    return max(areas, key=lambda area: area.width * area.height, default=None)


def layout_of(window: bpy.types.Window) -> list[bpy.types.Area]:
    """Return the 3D views of a window that look through cameras of views, each through its own."""
    cameras = {view.camera for view in window.scene.kfmocap.views}
    spaces = [(area, area.spaces.active) for area in window.screen.areas if area.type == "VIEW_3D"]
    return [area for area, space in spaces if space.use_local_camera and space.camera in cameras]


def split(context: bpy.types.Context, cameras: Sequence[bpy.types.Object]) -> None:
    """Split the context's 3D view into one for each of two to four cameras."""
    space = view3d_of(context).spaces.active
    space.use_local_camera, space.camera = True, cameras[0]
    names = [camera.name for camera in cameras]
    bpy.app.timers.register(partial(_split_next, context.window, names), first_interval=0.0)


def join(context: bpy.types.Context) -> None:
    """Close the 3D views of a split but one, which looks through the scene's camera again."""
    areas = layout_of(context.window)
    kept = context.area if context.area in areas else areas[0]
    kept.spaces.active.use_local_camera = False
    others = {area.as_pointer() for area in areas if area != kept}
    bpy.app.timers.register(partial(_close_others, context.window, others), first_interval=0.0)


def _split_next(window: bpy.types.Window, cameras: Sequence[str]) -> float | None:
    """Split one 3D view of a layout that has too few; the time until the next, or None after the last."""
    areas = layout_of(window)
    if 0 < len(areas) < len(cameras):
        direction: Literal["HORIZONTAL", "VERTICAL"] = "VERTICAL" if len(areas) == 1 else "HORIZONTAL"
        if split_area(window, max(areas, key=lambda area: area.height), direction):
            return NEXT_DRAW
    if areas:
        _arrange(window, cameras)
    return None


def _arrange(window: bpy.types.Window, cameras: Sequence[str]) -> None:
    """Give the 3D views their cameras as one reads, the first at the top left; our sidebar stays in one of them."""
    areas = layout_of(window)
    middle = (min(a.y for a in areas) + max(a.y + a.height for a in areas)) / 2
    reading = sorted(areas, key=lambda a: (a.y + a.height <= middle + 2, a.x))
    with_sidebar = next((area for area in reading if _tab(area) == SIDEBAR_TAB), None)
    for area, name in zip(reading, cameras, strict=False):
        space = area.spaces.active
        space.camera = bpy.data.objects.get(name)
        space.show_region_toolbar, space.show_region_ui = False, area == with_sidebar
        part = part_with_performers(window.scene, space.camera) if space.camera is not None else WHOLE
        through_camera(window, window.screen, area, part)


def _close_others(window: bpy.types.Window, others: set[int]) -> float | None:
    """Close one of the 3D views of a split that are left over, and no other, as the user may split anew meanwhile;
    the time until the next, or None after the last.
    """
    views = [area for area in window.screen.areas if area.type == "VIEW_3D"]
    closed = [area for area in views if area.as_pointer() in others and area.spaces.active.use_local_camera]
    if len(closed) < len(views) and any(close_area(window, area) for area in reversed(closed)):
        return NEXT_DRAW
    for area in window.screen.areas:
        if area.type == "VIEW_3D" and area.spaces.active.region_3d.view_perspective == "CAMERA":
            area.spaces.active.show_region_toolbar = area.spaces.active.show_region_ui = True
            through_camera(window, window.screen, area)
    return None


def close_area(window: bpy.types.Window, area: bpy.types.Area) -> bool:
    """Close an area; returns whether it had a neighbour of its size to take its place."""
    with bpy.context.temp_override(window=window, screen=window.screen, area=area, region=region_of(area)):
        close: Any = bpy.ops.screen.area_close
        return bool(close.poll() and close() == {"FINISHED"})


def split_area(
    window: bpy.types.Window,
    area: bpy.types.Area,
    direction: Literal["HORIZONTAL", "VERTICAL"],
    share: float = 0.5,
) -> bool:
    """Split off an area's lower or left part, which shows the same; returns whether it was large enough."""
    with bpy.context.temp_override(window=window, screen=window.screen, area=area, region=region_of(area)):
        split: Any = bpy.ops.screen.area_split
        return bool(split(direction=direction, factor=share) == {"FINISHED"})


def through_camera(
    window: bpy.types.Window, screen: bpy.types.Screen, area: bpy.types.Area, part: Part = WHOLE
) -> None:
    """Have a 3D view look through its camera, zoomed to a part of the picture."""
    space = area.spaces.active
    space.region_3d.view_perspective = "CAMERA"
    space.shading.wireframe_color_type = "OBJECT"  # the parts are white
    space.show_gizmo_navigate = False  # it lies over the footage
    see_through_skins(window)
    fit(window, screen, area, bpy.ops.view3d.view_center_camera)
    region = region_of(area)
    if region.width > 1 and region.height > 1:
        zoom, offset = framing(
            _box(region), uncovered_part(area), _aspect(window.scene), space.region_3d.view_camera_zoom, part
        )
        space.region_3d.view_camera_zoom, space.region_3d.view_camera_offset = zoom, offset


def uncovered_part(area: bpy.types.Area, but: str = "") -> Box:
    """Return what bars and sidebars leave free of a 3D view, but for the regions of one type.

    The panel of the last operator floats over the view: it comes and goes, and nothing makes way for it.
    """
    over = [r for r in area.regions if r.type not in ("WINDOW", "HUD", but) and r.width > 1 and r.height > 1]
    return free_box(_box(region_of(area)), [_box(r) for r in over])


def free_box(region: Box, others: Sequence[Box]) -> Box:
    """Return what bars and sidebars leave free of a region that they lie over (Blender's setting Region Overlap)."""
    left, bottom, right, top = region
    for x0, y0, x1, y1 in others:
        if min(x1, region[2]) <= max(x0, region[0]) or min(y1, region[3]) <= max(y0, region[1]):
            continue  # it lies beside the region
        if y1 - y0 > x1 - x0:  # upright: at one of the sides
            left, right = (max(left, x1), right) if x0 <= region[0] else (left, min(right, x0))
        else:
            bottom, top = (max(bottom, y1), top) if y0 <= region[1] else (bottom, min(top, y0))
    return (left, bottom, right, top) if left < right and bottom < top else region


def framing(
    region: Box, free: Box, aspect: float, zoom: float, part: Part = WHOLE
) -> tuple[float, tuple[float, float]]:
    """Return the zoom and the offset of a camera's view that bring its picture into the free part of a region.

    Parameters
    ----------
    region, free : tuple of int
        Left, bottom, right and top, pixels.
    aspect : float
        Width of the picture by its height.
    zoom : float
        Blender's zoom at which the picture fills the region (view_center_camera).
    part : Part
        What of the picture is to be seen, at most `_MAX_MAGNIFICATION` times as large as in a picture that fills the
        region.

    Returns
    -------
    zoom : float
    offset : tuple of float
        Blender's: the picture moves to the left and down by 2 * scale * offset of the region's size, where scale is
        (sqrt(2) + zoom / 50)^2 / 4.
    """
    width, height = region[2] - region[0], region[3] - region[1]
    shown = min(width, height * aspect)
    fitting = min((free[2] - free[0]) / (part[2] - part[0]), (free[3] - free[1]) * aspect / (part[3] - part[1]))
    larger = min(1.0 if part == WHOLE else _MAX_MAGNIFICATION, fitting / shown)
    root = (math.sqrt(2) + zoom / 50) * math.sqrt(larger)
    scale = root**2 / 4
    size = (shown * larger, shown * larger / aspect)
    beside = [((part[i] + part[i + 2]) / 2 - 0.5) * size[i] for i in (0, 1)]
    moved = [((free[i] + free[i + 2]) - (region[i] + region[i + 2])) / 2 - beside[i] for i in (0, 1)]
    return 50 * (root - math.sqrt(2)), (-moved[0] / (2 * scale * width), -moved[1] / (2 * scale * height))


def _box(region: bpy.types.Region) -> Box:
    return region.x, region.y, region.x + region.width, region.y + region.height


def fit(window: bpy.types.Window, screen: bpy.types.Screen, area: bpy.types.Area, operator: Any) -> None:
    """Call an operator that fits what an area shows into it, where it can be called."""
    with bpy.context.temp_override(window=window, screen=screen, area=area, region=region_of(area)):
        if operator.poll():
            operator()


def region_of(area: bpy.types.Area, kind: str = "WINDOW") -> bpy.types.Region:
    """Return the region of an area that has some type."""
    return next(region for region in area.regions if region.type == kind)


def _tab(area: bpy.types.Area) -> str:
    """Return the sidebar's tab that is open in a 3D view."""
    return region_of(area, "UI").active_panel_category if area.spaces.active.show_region_ui else ""
