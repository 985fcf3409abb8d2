"""3D views of a window that look through the cameras of views: one, or up to four side by side."""

from __future__ import annotations

import bpy

MOST = 4


def look(context: bpy.types.Context) -> None:
    """Let the 3D view of a context look through the scene's camera, all of its picture in sight.

    Where several look through cameras of their own, this one's becomes the scene's.
    """
    area = view3d_of(context)
    if area is None or context.scene.camera is None:
        return
    space = area.spaces.active
    if area in layout_of(context) and len(layout_of(context)) > 1:
        space.camera = context.scene.camera
    else:
        space.use_local_camera = False
    _through_camera(context, area)


def view3d_of(context: bpy.types.Context) -> bpy.types.Area | None:
    """The 3D view that the context is in, else the largest of its window."""
    if context.area is not None and context.area.type == "VIEW_3D":
        return context.area
    areas = [a for a in context.screen.areas if a.type == "VIEW_3D"] if context.screen is not None else []
    return max(areas, key=lambda area: area.width * area.height, default=None)


def layout_of(context: bpy.types.Context) -> list[bpy.types.Area]:
    """The 3D views of the window that look through cameras of views, each through its own."""
    cameras = {view.camera for view in context.scene.kfmocap.views}
    return [
        area
        for area in (context.screen.areas if context.screen is not None else ())
        if area.type == "VIEW_3D" and area.spaces.active.use_local_camera and area.spaces.active.camera in cameras
    ]


def split(context: bpy.types.Context, cameras: list[bpy.types.Object]) -> None:
    """Split the context's 3D view into one for each of two to four cameras."""
    area = view3d_of(context)
    areas = [area, _split(context, area, "VERTICAL")]
    for half in areas[: len(cameras) - 2]:
        areas.append(_split(context, half, "HORIZONTAL"))
    # Splitting moves the old area to one side: as one reads, the first camera is at the top left.
    areas.sort(key=lambda a: (a.y + a.height / 2 < area_middle(areas), a.x))
    for area, camera in zip(areas, cameras, strict=True):
        space = area.spaces.active
        space.use_local_camera, space.camera = True, camera
        space.show_region_ui = space.show_region_toolbar = False
        _through_camera(context, area)
    areas[0].spaces.active.show_region_ui = True


def join(context: bpy.types.Context) -> None:
    """Close the 3D views of a split but one, which looks through the scene's camera again."""
    areas = layout_of(context)
    kept = context.area if context.area in areas else areas[0]
    for area in [a for a in areas if a != kept]:
        with context.temp_override(area=area, region=_window(area)):
            bpy.ops.screen.area_close()
    kept.spaces.active.use_local_camera = False
    _through_camera(context, kept)


def area_middle(areas: list[bpy.types.Area]) -> float:
    """Height of the middle of areas in the window, pixels."""
    return (min(a.y for a in areas) + max(a.y + a.height for a in areas)) / 2


def _split(context: bpy.types.Context, area: bpy.types.Area, direction: str) -> bpy.types.Area:
    before = set(context.screen.areas)
    with context.temp_override(area=area, region=_window(area)):
        bpy.ops.screen.area_split(direction=direction, factor=0.5)
    (new,) = set(context.screen.areas) - before
    return new


def _through_camera(context: bpy.types.Context, area: bpy.types.Area) -> None:
    area.spaces.active.region_3d.view_perspective = "CAMERA"
    with context.temp_override(area=area, region=_window(area)):
        if bpy.ops.view3d.view_center_camera.poll():
            bpy.ops.view3d.view_center_camera()


def _window(area: bpy.types.Area) -> bpy.types.Region:
    return next(region for region in area.regions if region.type == "WINDOW")
