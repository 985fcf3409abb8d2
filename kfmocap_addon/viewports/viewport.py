"""What a 3D view shows of a shot: which view it looks through, and where in it things are.

Positions in a region are pixels from its lower left; places in a picture are (x / z, y / z) in OpenCV's camera axes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import bpy
from bpy_extras import view3d_utils
from mathutils import Vector


@dataclass(frozen=True)
class Look:
    """A 3D view that looks through the camera of one of the shot's views."""

    area: bpy.types.Area
    region: bpy.types.Region
    space: bpy.types.Space
    view: bpy.types.PropertyGroup

    def place(self, x: float, y: float) -> tuple[float, float]:
        """Place in the picture of a position in the region."""
        ray = view3d_utils.region_2d_to_vector_3d(self.region, self.space.region_3d, (x, y))
        seen = self.view.camera.matrix_world.to_3x3().normalized().transposed() @ ray
        return seen.x / -seen.z, seen.y / seen.z

    def position(self, place: Sequence[float]) -> Vector | None:
        """Position in the region of a place in the picture; None where it is not before the camera."""
        return self.position_of(self.view.camera.matrix_world @ Vector((place[0], -place[1], -1.0)))

    def position_of(self, point_world: Vector) -> Vector | None:
        """Position in the region of a point of the world; None where it is behind the camera."""
        return view3d_utils.location_3d_to_region_2d(self.region, self.space.region_3d, point_world)


def look_of(
    scene: bpy.types.Scene, area: bpy.types.Area, region: bpy.types.Region, space: bpy.types.Space
) -> Look | None:
    """Return how a 3D view looks at the shot; None where it does not look through one of its cameras."""
    region_3d = space.region_3d
    if region_3d is None or region_3d.view_perspective != "CAMERA":
        return None
    camera = space.camera if space.use_local_camera else scene.camera
    view = next((v for v in scene.kfmocap.views if v.camera is not None and v.camera == camera), None)
    return Look(area, region, space, view) if view is not None else None


def area_under(window: bpy.types.Window, x: int, y: int) -> tuple[bpy.types.Area, bpy.types.Region] | None:
    """Return the area and the region of a window under the mouse; sidebars lie over what they cover."""
    for area in window.screen.areas:
        under = [r for r in area.regions if r.x <= x < r.x + r.width and r.y <= y < r.y + r.height]
        if under:
            return area, next((r for r in under if r.type != "WINDOW"), under[0])
    return None


def look_under(context: bpy.types.Context, x: int, y: int) -> Look | None:
    """Return how the 3D view under the mouse looks at the shot."""
    under = area_under(context.window, x, y)
    if under is None or under[0].type != "VIEW_3D" or under[1].type != "WINDOW":
        return None
    return look_of(context.scene, *under, under[0].spaces.active)


def redraw(context: bpy.types.Context) -> None:
    """Have all 3D views drawn again."""
    for window in context.window_manager.windows:
        for area in window.screen.areas:
            if area.type == "VIEW_3D":
                area.tag_redraw()
