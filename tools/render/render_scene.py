"""The Blender scene of synthetic footage: room, light, figure and cameras. Needs the bpy module."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import bpy
import cv2
import numpy as np
from kfmocap.core.cameras.camera import Camera
from kfmocap.core.numerics.arrays import Array
from mathutils import Matrix
from numpy.typing import NDArray

from .figure import Figure
from .textures import planks, plaster

IntArray = NDArray[np.int64]
Image = NDArray[np.uint8]

ROOM = ((-4.6, -5.2), (4.6, 4.0), 3.2)
"""Two corners of the floor and the height, metres."""
BOARD = (0.6, 1.3)
"""Width and height of the board that may pass in front, metres."""
SAMPLES = 6
FIGURE, SUN = "Figure", "Sun"


def build(figure: Figure) -> bpy.types.Mesh:
    """Build a scene with the room, its light and the figure; returns the figure's mesh."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    _render_settings(scene)
    _light(scene)
    _room()
    return _figure(figure)


def render(
    mesh: bpy.types.Mesh,
    vertices: Array,
    cameras: list[Camera],
    folder: Path,
    frames: list[int],
    *,
    board_path: Array | None = None,
) -> Iterator[tuple[str, int, Image]]:
    """Render frames of posed vertices (F, V, 3); yields camera name, frame and BGR picture.

    The room is rendered once per camera; every frame renders only the rectangle around the figure and its shadow.
    A board may pass through the pictures, its centre at `board_path` (F, 3). The cameras must have
    no distortion: Blender renders pinhole images. `folder` is for temporary files.
    """
    scene, figure = bpy.context.scene, bpy.data.objects[FIGURE]
    objects = {camera.name: _camera(camera) for camera in cameras}
    figure.hide_render = True
    rooms = {c.name: _picture(scene, objects[c.name], c, folder, seed=0, samples=4 * SAMPLES) for c in cameras}
    figure.hide_render = False
    board = None if board_path is None else _board()
    for frame in frames:
        moving = vertices[frame][::7]
        if board is not None:
            board.location = board_path[frame]
            moving = np.concatenate([moving, board_path[frame] + board_corners()])
        mesh.vertices.foreach_set("co", vertices[frame].astype(np.float32).ravel())
        mesh.update()
        for camera in cameras:
            low, high = _touched(camera, moving)
            part = _picture(
                scene, objects[camera.name], camera, folder, seed=frame + 1, samples=SAMPLES, box=(low, high)
            )
            yield camera.name, frame, _pasted(rooms[camera.name], part, low)


def _picture(
    scene: bpy.types.Scene,
    obj: bpy.types.Object,
    camera: Camera,
    folder: Path,
    *,
    seed: int,
    samples: int,
    box: tuple[IntArray, IntArray] | None = None,
) -> Image:
    """Render a camera's whole picture, or the box of pixels (low, high), high exclusive."""
    size = np.array(camera.size)
    low, high = box if box is not None else (np.zeros(2), size)
    render, path = scene.render, folder / "picture.png"
    scene.camera, scene.cycles.seed, scene.cycles.samples = obj, seed, samples
    render.resolution_x, render.resolution_y = camera.size
    render.use_border = render.use_crop_to_border = box is not None
    # Blender truncates the fractions to whole pixels from the lower left; a quarter of a pixel guards the edge.
    render.border_min_x, render.border_max_x = (low[0] + 0.25) / size[0], (high[0] + 0.25) / size[0]
    render.border_min_y, render.border_max_y = 1 - (high[1] - 0.25) / size[1], 1 - (low[1] - 0.25) / size[1]
    render.filepath = str(path)
    bpy.ops.render.render(write_still=True)
    image = cv2.imread(str(path))
    if image is None or image.shape[:2] != tuple(int(n) for n in (high - low)[::-1]):
        raise RuntimeError(f"{path} is not the picture that was asked for")
    return image


def _pasted(room: Image, part: Image, low: IntArray, ramp: int = 10) -> Image:
    """Paste a part over the picture of the room, blended at its border so that no seam shows."""
    image = room.astype(float)
    rows, columns = part.shape[:2]
    up, across = (np.minimum(np.arange(n), np.arange(n)[::-1]) for n in (rows, columns))
    share = np.clip((np.minimum(up[:, None], across[None, :]) + 1) / ramp, 0, 1)[..., None]
    under = image[low[1] : low[1] + rows, low[0] : low[0] + columns]
    under += share * (part - under)
    return image.round().astype(np.uint8)


def _touched(camera: Camera, points: Array, margin: int = 20) -> tuple[IntArray, IntArray]:
    """Box of pixels around moving points and their shadow on the floor."""
    sun = np.array(bpy.data.objects[SUN].matrix_world)[:3, :3] @ [0, 0, -1.0]
    shadow = points - points[:, 2:] / sun[2] * sun
    uv = camera.project(np.concatenate([points, shadow, points * [1, 1, 0]]))
    size = np.array(camera.size)
    low = np.clip(np.floor(uv.min(axis=0)) - margin, 0, size)
    return low.astype(int), np.clip(np.ceil(uv.max(axis=0)) + margin, 0, size).astype(int)


def _render_settings(scene: bpy.types.Scene) -> None:
    scene.render.engine = "CYCLES"
    scene.cycles.device = "CPU"
    scene.cycles.use_adaptive_sampling = False
    scene.cycles.max_bounces = 0
    scene.cycles.use_denoising = True
    scene.cycles.denoising_quality = "FAST"
    scene.render.resolution_percentage = 100
    scene.render.use_persistent_data = True
    scene.view_settings.view_transform = "Standard"
    scene.render.image_settings.file_format = "PNG"
    scene.render.image_settings.compression = 10


def _light(scene: bpy.types.Scene) -> None:
    world = bpy.data.worlds.new("World")
    scene.world = world
    world.use_nodes = True
    background = world.node_tree.nodes["Background"]
    background.inputs["Color"].default_value = (0.9, 0.95, 1.0, 1)
    background.inputs["Strength"].default_value = 0.9
    sun = bpy.data.lights.new(SUN, "SUN")
    sun.energy, sun.angle = 2.9, np.radians(20)
    lamp = bpy.data.objects.new(SUN, sun)
    lamp.rotation_euler = np.radians([38, -22, 0])
    scene.collection.objects.link(lamp)


def _room() -> None:
    (x0, y0), (x1, y1), height = ROOM
    _panel("Floor", planks(x1 - x0, y1 - y0, seed=3), [(x0, y0, 0), (x1, y0, 0), (x1, y1, 0), (x0, y1, 0)])
    corners = [(x0, y1), (x1, y1), (x1, y0), (x0, y0)]
    for i, ((ax, ay), (bx, by)) in enumerate(zip(corners, corners[1:] + corners[:1], strict=True)):
        width = float(np.hypot(bx - ax, by - ay))
        wall = [(ax, ay, 0), (bx, by, 0), (bx, by, height), (ax, ay, height)]
        _panel(f"Wall {i + 1}", plaster(width, height, seed=20 + 10 * i), wall)


def _panel(name: str, pixels: Array, corners: list[tuple[float, ...]]) -> bpy.types.Object:
    """A textured rectangle, corners counter-clockwise from the image's lower left."""
    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata(corners, [], [(0, 1, 2, 3)])
    mesh.uv_layers.new(name="UVMap").data.foreach_set("uv", [0, 0, 1, 0, 1, 1, 0, 1])
    rows, columns = pixels.shape[:2]
    image = bpy.data.images.new(name, columns, rows)
    image.pixels.foreach_set(np.dstack([pixels, np.ones((rows, columns))]).astype(np.float32).ravel())
    material, nodes = _material(name)
    texture = nodes.new("ShaderNodeTexImage")
    texture.image, texture.interpolation = image, "Cubic"
    material.node_tree.links.new(texture.outputs["Color"], nodes["Matt"].inputs["Color"])
    mesh.materials.append(material)
    obj = bpy.data.objects.new(name, mesh)
    bpy.context.scene.collection.objects.link(obj)
    return obj


def board_corners() -> Array:
    """Corners of the board about its centre, metres, shape (4, 3): upright, parallel to the walk."""
    x, z = BOARD[0] / 2, BOARD[1] / 2
    return np.array([[-x, 0, -z], [x, 0, -z], [x, 0, z], [-x, 0, z]])


def _board() -> bpy.types.Object:
    return _panel("Board", plaster(*BOARD, seed=70), [tuple(corner) for corner in board_corners()])


def _figure(figure: Figure) -> bpy.types.Mesh:
    mesh = bpy.data.meshes.new(FIGURE)
    mesh.from_pydata(figure.vertices, [], figure.triangles)
    mesh.polygons.foreach_set("use_smooth", np.ones(len(figure.triangles), dtype=bool))
    sRGB = figure.colours
    linear = np.where(sRGB <= 0.04045, sRGB / 12.92, ((sRGB + 0.055) / 1.055) ** 2.4)
    layer = mesh.attributes.new("colour", "FLOAT_COLOR", "POINT")
    layer.data.foreach_set("color", np.c_[linear, np.ones(len(linear))].astype(np.float32).ravel())
    material, nodes = _material(FIGURE)
    attribute = nodes.new("ShaderNodeAttribute")
    attribute.attribute_name = "colour"
    material.node_tree.links.new(attribute.outputs["Color"], nodes["Matt"].inputs["Color"])
    mesh.materials.append(material)
    bpy.context.scene.collection.objects.link(bpy.data.objects.new(FIGURE, mesh))
    return mesh


def _material(name: str) -> tuple[bpy.types.Material, bpy.types.Nodes]:
    material = bpy.data.materials.new(name)
    material.use_nodes = True
    nodes = material.node_tree.nodes
    nodes.clear()
    matt, output = nodes.new("ShaderNodeBsdfDiffuse"), nodes.new("ShaderNodeOutputMaterial")
    matt.name = "Matt"
    material.node_tree.links.new(matt.outputs[0], output.inputs["Surface"])
    return material, nodes


def _camera(camera: Camera) -> bpy.types.Object:
    """A Blender camera with square pixels whose pixel centres are at integer coordinates."""
    width, height = camera.size
    (fx, _, cx), (_, _, cy), _ = camera.matrix
    data = bpy.data.cameras.new(camera.name)
    data.sensor_fit, data.sensor_width = "HORIZONTAL", 36
    data.lens = fx * 36 / width
    data.shift_x = -((cx + 0.5) - width / 2) / width
    data.shift_y = ((cy + 0.5) - height / 2) / width
    obj = bpy.data.objects.new(camera.name, data)
    R, t = camera.pose(0)
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = R.T @ np.diag([1, -1, -1]), -R.T @ t
    obj.matrix_world = Matrix(pose.tolist())
    bpy.context.scene.collection.objects.link(obj)
    return obj
