"""Skins of characters that are see-through while one looks through the camera of a view: they would hide the footage.

It is the 3D view's own X-ray, so no object changes. It is as before once the view looks elsewhere.
"""

from __future__ import annotations

from collections.abc import Iterator

import bpy

from ..scene_io import active_performer
from ..session import SESSION
from . import viewport


class SeenThrough:
    """The 3D views that had no X-ray before they were made to look through skins, by their pointers."""

    def __init__(self) -> None:
        self.views: set[int] = set()
        self._timer = self.take_back_elsewhere  # one object: Blender knows its timers by identity

    def clear(self) -> None:
        """Take back every X-ray."""
        if bpy.app.timers.is_registered(self._timer):
            bpy.app.timers.unregister(self._timer)
        for _, space in _views():
            self._take_back(space)
        self.views.clear()

    def drawn(self) -> None:
        """Have the X-ray of the 3D view that is being drawn taken back where it looks elsewhere."""
        context = bpy.context
        if context.space_data.as_pointer() not in self.views or bpy.app.timers.is_registered(self._timer):
            return
        if viewport.look_of(context.scene, context.area, context.region, context.space_data) is None:
            bpy.app.timers.register(self._timer, first_interval=0.0)  # not while it is drawn

    def take_back_elsewhere(self) -> None:
        """Take back the X-ray of those 3D views that do not look through the camera of a view."""
        for window, space in _views():
            if not _looks(window.scene, space):
                self._take_back(space)

    def _take_back(self, space: bpy.types.Space) -> None:
        if space.as_pointer() in self.views:
            self.views.remove(space.as_pointer())
            space.shading.show_xray = False


def see_through_skins(window: bpy.types.Window | None) -> None:
    """Switch on X-ray in the 3D views of a window that look through the camera of a view, if a performer is a character
    with a skin.
    """
    from ..scene_io.body import part_meshes

    if window is None or not any(
        active_performer.is_present(window.scene, slot) and part_meshes.is_of_skin(slot.armature)
        for slot in window.scene.kfmocap.performers
    ):
        return
    seen = SESSION.of(SeenThrough).views
    for each, space in _views():
        if each != window or not _looks(window.scene, space):
            continue
        # One of several cameras side by side was split off a view with its X-ray.
        if not space.shading.show_xray or (space.use_local_camera and seen):
            seen.add(space.as_pointer())
            space.shading.show_xray = True


def _views() -> Iterator[tuple[bpy.types.Window, bpy.types.Space]]:
    for window in bpy.context.window_manager.windows:
        for area in window.screen.areas:
            if area.type == "VIEW_3D":
                yield window, area.spaces.active


def _looks(scene: bpy.types.Scene, space: bpy.types.Space) -> bool:
    camera = space.camera if space.use_local_camera else scene.camera
    return space.region_3d.view_perspective == "CAMERA" and any(v.camera == camera for v in scene.kfmocap.views)


def register() -> None:
    """Watch where 3D views look."""
    handle = bpy.types.SpaceView3D.draw_handler_add(SESSION.of(SeenThrough).drawn, (), "WINDOW", "POST_PIXEL")
    SESSION.on_end(bpy.types.SpaceView3D.draw_handler_remove, handle, "WINDOW")
