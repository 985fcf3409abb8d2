"""Solved cameras in a scene: camera objects before their footage, the wand's cloud, the L-frame."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import bpy
import numpy as np
from numpy.typing import NDArray

from ...core.cameras.camera import Camera
from ...core.numerics.arrays import Array
from . import scene as scenes
from .cameras import footage_background, scene_cameras

COLLECTION = "Calibration"


def show_cameras(
    scene: bpy.types.Scene,
    cameras: Mapping[str, Camera],
    footage: Mapping[str, Path] | None = None,
    offsets: Mapping[str, float] | None = None,
) -> list[bpy.types.Object]:
    """Build camera objects in the scene's collection "Calibration", in place of those of earlier calls.

    Parameters
    ----------
    cameras : mapping of str to Camera
    footage : mapping of str to Path, optional
        What to show behind each.
    offsets : mapping of str to float, optional
        The scene's first frame shows each video's frame of that number, or the nearest.
    """
    clips = {name: footage_background.load_clip(path) for name, path in (footage or {}).items()}
    for name, clip in clips.items():
        clip.frame_start = scene.frame_start - round((offsets or {}).get(name, 0.0))
    collection = _emptied(scene)
    built = [
        scene_cameras.build_camera(c, collection, scene.frame_start, clips.get(name)) for name, c in cameras.items()
    ]
    if built and scene.camera is None:
        scene.camera = built[0]
    return built


def show_points(scene: bpy.types.Scene, name: str, points: Array, edges: Sequence[tuple[int, int]]) -> bpy.types.Object:
    """Show points, shape (n, 3), and the lines between some of them in the collection "Calibration"."""
    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata(np.asarray(points, float).tolist(), list(edges), [])
    owner = bpy.data.objects.new(name, mesh)
    owner.hide_select, owner.hide_render = True, True
    scenes.ensure_collection(scene, COLLECTION).objects.link(owner)
    return owner


def forget(owners: Sequence[bpy.types.Object], scene: bpy.types.Scene) -> None:
    """Remove those of some camera objects that are in the collection "Calibration": what they say is kept elsewhere."""
    collection = scenes.find_collection(scene, COLLECTION)
    for owner in [o for o in owners if collection is not None and o.name in collection.objects]:
        data = owner.data
        bpy.data.objects.remove(owner)
        if data.users == 0:
            bpy.data.cameras.remove(data)


def _emptied(scene: bpy.types.Scene) -> bpy.types.Collection:
    collection = scenes.ensure_collection(scene, COLLECTION)
    for owner in list(collection.objects):
        data = owner.data
        bpy.data.objects.remove(owner)
        if data is not None and data.users == 0:
            (bpy.data.cameras if isinstance(data, bpy.types.Camera) else bpy.data.meshes).remove(data)
    return collection


def camera_objects(scene: bpy.types.Scene, selected: Sequence[bpy.types.Object] = ()) -> list[bpy.types.Object]:
    """Return the cameras that are meant: those selected, else those of the collection "Calibration", else all."""
    chosen = [owner for owner in selected if owner.type == "CAMERA"]
    collection = scenes.find_collection(scene, COLLECTION)
    calibrated = [owner for owner in collection.objects if owner.type == "CAMERA"] if collection is not None else []
    return chosen or calibrated or [owner for owner in scene.objects if owner.type == "CAMERA"]


def show_picture(name: str, picture: NDArray[np.uint8]) -> bpy.types.Image:
    """Return a picture in blue, green, red as an image of Blender's, in place of one of the same name."""
    height, width = picture.shape[:2]
    image: bpy.types.Image | None = bpy.data.images.get(name)
    if image is not None and tuple(image.size) != (width, height):
        image.scale(width, height)  # what shows it goes on showing it
    image = image or bpy.data.images.new(name, width, height)
    rgba = np.ones((height, width, 4), np.float32)
    rgba[..., :3] = picture[::-1, :, ::-1] / np.float32(255)
    image.pixels.foreach_set(rgba.ravel())
    image.update()
    return image
