"""The residual view: pictures of where footage and model differ, as camera backgrounds and in image editors."""

from __future__ import annotations

import bpy

from ...core.review.misfit_pictures import MisfitPicture, misfit_picture
from ..scene_io import scene as scenes
from ..scene_io import solved_cameras, tracked_segments
from ..scene_io.cameras import footage_background
from ..scene_io.keys import motion_curves


def show(scene: bpy.types.Scene, slot: bpy.types.PropertyGroup, frame: int) -> MisfitPicture:
    """Show the residual of one view on a scene frame over its footage; it is seen on that frame alone.

    Raises
    ------
    KFMocapError
        The scene's shot cannot be read, or there is nothing to compare with on that frame.
    """
    shot = tracked_segments.with_footage_offset(scene, scenes.shot_from_scene(scene))
    start = scene.kfmocap.frame_start
    view = next(v for v in shot.views if v.camera.name == slot.name)
    motions = [motion_curves.read_motion(s.armature, start, shot.length) for s in scene.kfmocap.performers]
    found = misfit_picture(shot, view, motions, frame - start)
    image = solved_cameras.show_picture(slot.residual_name, found.image)
    image.pack()
    data = slot.camera.data
    behind = next((b for b in data.background_images if b.image == image), None)
    if behind is None:
        behind = data.background_images.new()
        behind.source, behind.image = "IMAGE", image
    for index, background in enumerate(data.background_images):
        # What is first in the list covers the others: the footage makes room on that frame.
        _drive(
            data, index, f"1 if frame == {frame} else 0" if background == behind else f"0 if frame == {frame} else 1"
        )
    footage_background.refresh(scene)
    return found


def hide(scene: bpy.types.Scene) -> int:
    """Remove all residuals; returns how many there were."""
    gone = 0
    for slot in scene.kfmocap.views:
        image = slot.residual
        if image is None or slot.camera is None:
            continue
        data = slot.camera.data
        for index, background in enumerate(data.background_images):
            data.driver_remove(_shown(index))
            background.show_background_image = True
        for background in [b for b in data.background_images if b.image == image]:
            data.background_images.remove(background)
        bpy.data.images.remove(image)
        gone += 1
    return gone


def _drive(data: bpy.types.Camera, index: int, expression: str) -> None:
    """Make a camera's background picture visible only on some frames, as a residual would be wrong on others."""
    data.driver_remove(_shown(index))
    driver = data.driver_add(_shown(index)).driver
    driver.type, driver.expression = "SCRIPTED", expression


def _shown(index: int) -> str:
    return f"background_images[{index}].show_background_image"
