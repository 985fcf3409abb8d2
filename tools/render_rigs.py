#!/usr/bin/env python3
"""Render footage of characters that are moved by the controls of their rigs, as Blender shows them; needs the bpy
module.

    .venv/bin/python tools/render_rigs.py --out build/creatures [bird cat dragon robot avatar vroid]

Each gets a folder with its footage as pictures, calibration.toml and rig.blend: the character with its true motion on
every frame, the first at frame 1. All bones turn about axes of their own, with periods of about one second; hair and
cloth sway. What is there already is not rendered again. `--preview 0 30` writes PNG pictures of those frames instead.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

import bpy
import cv2
import numpy as np
from kfmocap.benchmarks.studies.shown_meshes import meshes_of, shown_vertices
from kfmocap.core.cameras.camera import Camera
from kfmocap.kfmocap_addon.registration import registered
from kfmocap.kfmocap_addon.retargeting.tracked_bodies.skinned_body import use_as_body
from kfmocap.kfmocap_addon.scene_io.body.body_armature import body_from_armature
from kfmocap.kfmocap_addon.scene_io.characters.skins import skinned_meshes
from mathutils import Matrix, Vector
from numpy.typing import NDArray
from render.chosen_shots import render_chosen
from render.dressed import sway
from render.painted_scene import Floor, PaintedView, Sensor, Surface, lit
from render.rig_folders import digest, write_folder, write_footage
from render.rig_parts import any_direction, colours_of, key_turn
from render.rigs import LINKED, RIGS
from render.takes import camera_looking_at
from scipy.spatial.transform import Rotation

Array = NDArray[np.float64]
FPS, FRAMES, FIRST = 30.0, 49, 1
EXPOSED = (-1 / 6, 0.0, 1 / 6)
"""Moments of a frame's exposure, frames."""
SWING, ROOT_SWING = 0.35, 0.14
"""Amplitude of the turns of bones, and of the topmost one, radians."""
LOOKS = ("creatures", "drawing", "dressed", "figure", "painted_scene", "rig_parts", "rigs", "shapes", "textures")
ANGLES = (-125.0, -65.0, -5.0)
"""Directions in which the cameras stand."""


def built(name: str, folder: Path) -> bpy.types.Object:
    """Build a character in an empty file; one that is linked comes from a file that is written into the folder."""
    _empty_file()
    armature = RIGS[name]()
    if name not in LINKED:
        return armature
    collection = bpy.data.collections.new("Character")
    for owner in (armature, *skinned_meshes(armature)):
        collection.objects.link(owner)
    library = folder / f"{name}.blend"
    bpy.data.libraries.write(str(library), {collection}, fake_user=True)
    _empty_file()
    bpy.ops.wm.save_as_mainfile(filepath=str(folder / "rig.blend"))
    with bpy.data.libraries.load(str(library), link=True, relative=True) as (_, loaded):
        loaded.collections = ["Character"]
    scene, layer = bpy.context.scene, bpy.context.view_layer
    instance = bpy.data.objects.new("Character", None)
    instance.instance_type, instance.instance_collection = "COLLECTION", loaded.collections[0]
    scene.collection.objects.link(instance)
    layer.update()
    loaded.collections[0].override_hierarchy_create(scene, layer, reference=instance)
    bpy.data.objects.remove(instance)
    overridden = next(owner for owner in scene.objects if owner.type == "ARMATURE" and owner.override_library)
    overridden.override_library.is_system_override = False
    return overridden


def _empty_file() -> None:
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    scene = bpy.context.scene
    scene.render.fps, scene.frame_start, scene.frame_end = round(FPS), FIRST, FIRST + FRAMES - 1


def controls(name: str, folder: Path) -> list[str]:
    """Return the bones that move a character: those that carry the parts of the body that it becomes."""
    with registered():
        armature = built(name, folder)
        armature, _ = use_as_body(bpy.context.scene, armature)
        return list(body_from_armature(armature).names)


def animate(armature: bpy.types.Object, bones: Sequence[str], seed: int) -> None:
    """Key turns of bones on every frame, as far as their axes are not locked, and the way of the first one."""
    rng = np.random.default_rng(seed)
    t = np.arange(FRAMES) / FPS
    for k, name in enumerate(bones):
        bone = armature.pose.bones[name]
        axis, size = any_direction(rng), SWING * rng.uniform(0.6, 1.2) if k else ROOT_SWING
        frequency, phase, other = rng.uniform(0.8, 1.25), rng.uniform(0, 2 * np.pi), any_direction(rng)
        turn = 2 * np.pi * frequency * t[:, None]
        vectors = size * (np.sin(turn + phase) * axis + 0.4 * np.sin(0.6 * turn + 2 * phase) * other)
        vectors[:, list(bone.lock_rotation)] = 0
        for f, matrix in enumerate(Rotation.from_rotvec(vectors).as_matrix()):
            key_turn(bone, Matrix(matrix.tolist()), FIRST + f)
    _move(armature, armature.pose.bones[bones[0]], 2 * np.pi * t)


def _move(armature: bpy.types.Object, bone: bpy.types.PoseBone, turns: Array) -> None:
    """Key the way of a bone: a quarter of a metre to each side, in waves of the frames' turns (F,), radians."""
    ways = [np.sin(0.7 * turns), 0.8 * (np.sin(0.5 * turns + 1) - np.sin(1)), 0.4 * np.sin(0.9 * turns)]
    to_bone = (armature.matrix_world.to_3x3() @ bone.bone.matrix_local.to_3x3()).inverted()
    for f, way in enumerate(0.25 * np.stack(ways, axis=1)):
        bone.location = to_bone @ Vector(way.tolist())
        bone.keyframe_insert("location", frame=FIRST + f)


def shown(owners: Sequence[bpy.types.Object], frame: float) -> Array:
    """Return the vertices of meshes at a moment between two frames, see `shown_vertices`."""
    whole = int(np.floor(frame))
    bpy.context.scene.frame_set(whole, subframe=frame - whole)
    return shown_vertices(owners)


def cameras_around(owners: Sequence[bpy.types.Object]) -> list[Camera]:
    """Return three cameras that see meshes during all of their motion."""
    points = np.concatenate([shown(owners, frame) for frame in range(FIRST, FIRST + FRAMES, 8)])
    low, high = points.min(axis=0), points.max(axis=0)
    middle = (low + high) / 2
    radius = max(1.05 * float(np.linalg.norm(high - low)), 1.7 * float(high[2] - low[2]))
    cameras = []
    for k, (angle, far, up) in enumerate(zip(np.radians(ANGLES), (1, 1.08, 0.95), (0.25, 0.4, 0.15), strict=True)):
        place = middle + radius * np.array([far * np.cos(angle), far * np.sin(angle), far * up])
        cameras.append(camera_looking_at(f"cam{k + 1:02d}", place, middle, 620.0))
    return cameras


def pictures(
    owners: Sequence[bpy.types.Object], cameras: Sequence[Camera], frames: Sequence[int]
) -> Iterator[tuple[int, int, NDArray[np.uint8]]]:
    """Render frames; yields the view's number, the frame and its picture."""
    triangles, start = [], 0
    for owner in owners:
        owner.data.calc_loop_triangles()
        corners = np.empty(3 * len(owner.data.loop_triangles), np.int32)
        owner.data.loop_triangles.foreach_get("vertices", corners)
        triangles.append(corners.reshape(-1, 3).astype(np.int64) + start)
        start += len(owner.data.vertices)
    colours = np.concatenate([colours_of(owner.data) for owner in owners])[:, ::-1]
    views, sensor = [PaintedView(camera, None) for camera in cameras], Sensor()
    for frame in frames:
        moments = [
            Surface(shown(owners, FIRST + frame + moment), np.concatenate(triangles), colours) for moment in EXPOSED
        ]
        light, floor = lit(moments[1]), Floor(moments[1].vertices)
        for v, view in enumerate(views):
            rng = np.random.default_rng([frame, v])
            yield v, frame, sensor.recorded(view.exposed(moments, light, floor).light, rng)


def moving(name: str, folder: Path) -> bpy.types.Object:
    """Build a character with its motion; files that it needs are written into the folder."""
    bones = controls(name, folder)
    armature = built(name, folder)
    animate(armature, bones, seed=len(name))
    sway(armature, range(FIRST, FIRST + FRAMES), FPS, seed=len(name))
    return armature


def render_rig(name: str, out: Path) -> None:
    """Render a character into a folder of its name, unless it is there."""

    def write(folder: Path) -> None:
        owners = meshes_of(moving(name, folder))
        cameras = cameras_around(owners)
        write_footage(folder, cameras, pictures(owners, cameras, range(FRAMES)))
        bpy.context.scene.frame_set(FIRST)
        bpy.ops.wm.save_as_mainfile(filepath=str(folder / "rig.blend"))
        (folder / "rig.blend1").unlink(missing_ok=True)

    write_folder(out / name, digest(name, Path(__file__), LOOKS), write)


def preview(name: str, frames: Sequence[int], out: Path) -> None:
    """Write pictures of some frames."""
    owners = meshes_of(moving(name, out))
    cameras = cameras_around(owners)
    for v, frame, image in pictures(owners, cameras, frames):
        cv2.imwrite(str(out / f"{name}_{cameras[v].name}_{frame:04d}.png"), image)


if __name__ == "__main__":
    render_chosen(__doc__, RIGS, render_rig, preview)
