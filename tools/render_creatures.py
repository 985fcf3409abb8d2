#!/usr/bin/env python3
"""Render footage of characters whose rigs are unlike the tracker's own body, with their rigs; needs the bpy module.

    .venv/bin/python tools/render_creatures.py --out build/creatures [person dog hammer worker]

Each gets a folder with its footage as pictures, calibration.toml and rig.blend: the skinned character with its true
motion on every frame, the first at frame 1. What is there already is not rendered again. `--preview 0 30` writes PNG
pictures of those frames instead.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

import bpy
import cv2
import numpy as np
from kfmocap.core.body import part_poses
from mathutils import Matrix, Vector
from numpy.typing import NDArray
from render.chosen_shots import render_chosen
from render.creatures import CREATURES, FPS, FRAMES, Creature, HeldProp
from render.drawing import linear
from render.painted_scene import Floor, PaintedView, Sensor, Surface, lit
from render.rig_folders import digest, write_folder, write_footage
from render.rig_parts import any_direction, bind, coloured_mesh, key_turn
from scipy.spatial.transform import Rotation

Array = NDArray[np.float64]
EXPOSURE, MOMENTS = 0.5, 3
"""Share of the time between frames, and the times at which it is sampled."""
LOOKS = ("creatures", "drawing", "figure", "movement_phrases", "painted_scene", "rig_parts", "shapes", "textures")
FIRST = 1
"""Frame of the rig's file that shows the first picture."""


def pictures(creature: Creature, frames: Sequence[int]) -> Iterator[tuple[int, int, NDArray[np.uint8]]]:
    """Render frames; yields the view's number, the frame and its picture."""
    figure = creature.figure
    figures = [figure] if creature.prop is None else [figure, creature.prop.figure]
    colours = linear(np.concatenate([each.colours for each in figures])[:, ::-1])
    triangles = np.concatenate(
        [each.triangles + start for each, start in zip(figures, (0, len(figure.vertices)), strict=False)]
    )
    views = [PaintedView(camera, None) for camera in creature.cameras]
    sensor = Sensor()
    for frame in frames:
        times = (frame + EXPOSURE * ((np.arange(MOMENTS) + 0.5) / MOMENTS - 0.5)) / FPS
        motion = creature.motion(times)
        skins = figure.posed(motion)
        if creature.prop is not None:
            held = creature.prop.figure.skinned(*creature.prop.poses(figure.body, motion))
            skins = np.concatenate([skins, held], axis=1)
        moments = [Surface(skin, triangles, colours) for skin in skins]
        middle = moments[MOMENTS // 2]
        light, floor = lit(middle), Floor(middle.vertices)
        for v, view in enumerate(views):
            rng = np.random.default_rng([frame, v, *creature.name.encode()])
            yield v, frame, sensor.recorded(view.exposed(moments, light, floor).light, rng)


def build_rig(creature: Creature) -> bpy.types.Object:
    """Build the armature with its skin and its true motion in an empty file; returns the armature."""
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    scene = bpy.context.scene
    scene.render.fps, scene.frame_start, scene.frame_end = round(FPS), FIRST, FIRST + FRAMES - 1
    armature = bpy.data.objects.new(creature.name, bpy.data.armatures.new(creature.name))
    scene.collection.objects.link(armature)
    turn = np.eye(3) if creature.upright else Rotation.from_euler("x", 90, degrees=True).as_matrix()
    matrix = np.eye(4)
    matrix[:3, :3] = creature.scale * turn
    armature.matrix_world = Matrix(matrix.tolist())
    axes = _add_bones(creature, armature, np.linalg.inv(matrix))
    _add_skin(creature, armature, np.linalg.inv(matrix))
    for bone, mode in zip(armature.pose.bones, creature.modes * len(armature.pose.bones), strict=False):
        bone.rotation_mode = mode
    _animate(creature, armature, axes, creature.scale * turn)
    if creature.prop is not None:
        _add_prop(creature, creature.prop)
    return armature


def _add_prop(creature: Creature, prop: HeldProp) -> None:
    """Add what is held as a mesh object with its true motion on its own channels."""
    figure = prop.figure
    mesh = bpy.data.meshes.new(figure.body.names[0])
    points = (figure.vertices - figure.T_stance[0]) @ figure.R_stance[0]
    mesh.from_pydata(points.tolist(), [], figure.triangles.tolist())
    thing = bpy.data.objects.new(figure.body.names[0], mesh)
    bpy.context.scene.collection.objects.link(thing)
    thing.rotation_mode = "QUATERNION"
    R, T = prop.poses(creature.figure.body, creature.motion(np.arange(FRAMES) / FPS))
    for f in range(FRAMES):
        turned = Matrix(R[f, 0].tolist()).to_quaternion()
        if f:
            turned.make_compatible(thing.rotation_quaternion)
        thing.location, thing.rotation_quaternion = T[f, 0].tolist(), turned
        for channel in ("location", "rotation_quaternion"):
            thing.keyframe_insert(channel, frame=FIRST + f)


def _add_bones(creature: Creature, armature: bpy.types.Object, to_local: Array) -> Array:
    """Add bones that point anywhere; returns their rest orientations in the armature, shape (P, 3, 3)."""
    figure, rng = creature.figure, np.random.default_rng(len(creature.name))
    bpy.context.view_layer.objects.active = armature
    bpy.ops.object.mode_set(mode="EDIT")
    bones = armature.data.edit_bones
    length = 0.1 / creature.scale
    for i, part in enumerate(figure.body.parts):
        bone = bones.new(creature.bones[part.name])
        bone.head = Vector((to_local[:3, :3] @ figure.T_stance[i]).tolist())
        bone.tail = bone.head + Vector((length * any_direction(rng)).tolist())
        bone.roll = float(rng.uniform(-3, 3))
        bone.parent = bones[creature.bones[figure.body.parts[part.parent].name]] if part.parent >= 0 else None
    for name, (above, head, tail) in creature.spare.items():
        bone = bones.new(name)
        bone.head, bone.tail = (Vector((to_local[:3, :3] @ np.array(end)).tolist()) for end in (head, tail))
        bone.parent = bones[creature.bones[above]]
    bpy.ops.object.mode_set(mode="OBJECT")
    names = [creature.bones[name] for name in figure.body.names]
    return np.array([np.array(armature.data.bones[name].matrix_local)[:3, :3] for name in names])


def _add_skin(creature: Creature, armature: bpy.types.Object, to_local: Array) -> None:
    """Add the skin as one mesh below the armature, bound by an armature modifier."""
    figure = creature.figure
    points = figure.vertices @ to_local[:3, :3].T
    skin = coloured_mesh("skin", points, figure.triangles, figure.colours)
    names = (creature.bones[name] for name in figure.body.names)
    bind(skin, armature, dict(zip(names, figure.weights.T, strict=True)))


def _animate(creature: Creature, armature: bpy.types.Object, axes: Array, to_world: Array) -> None:
    """Key every frame of the motion on the bones' own channels."""
    figure = creature.figure
    R, T = part_poses(figure.body, creature.motion(np.arange(FRAMES) / FPS))
    turns = R @ np.swapaxes(figure.R_stance, -1, -2)  # from the rest pose, in the world
    rest = to_world / creature.scale @ axes
    for i, part in enumerate(figure.body.parts):
        bone = armature.pose.bones[creature.bones[part.name]]
        own = turns[:, i] if part.parent < 0 else np.swapaxes(turns[:, part.parent], -1, -2) @ turns[:, i]
        Q = rest[i].T @ own @ rest[i]
        for f in range(FRAMES):
            key_turn(bone, Matrix(Q[f].tolist()), FIRST + f)
            if part.parent < 0:
                bone.location = (rest[i].T @ (T[f, 0] - figure.T_stance[0]) / creature.scale).tolist()
                bone.keyframe_insert("location", frame=FIRST + f)


def render_creature(name: str, out: Path) -> None:
    """Render a character into a folder of its name, unless it is there."""

    def write(folder: Path) -> None:
        creature = CREATURES[name]()
        write_footage(folder, creature.cameras, pictures(creature, range(FRAMES)))
        build_rig(creature)
        bpy.ops.wm.save_as_mainfile(filepath=str(folder / "rig.blend"))

    write_folder(out / name, digest(name, Path(__file__), LOOKS), write)


def preview(name: str, frames: Sequence[int], out: Path) -> None:
    """Write pictures of some frames."""
    creature = CREATURES[name]()
    for v, frame, image in pictures(creature, frames):
        cv2.imwrite(str(out / f"{name}_{creature.cameras[v].name}_{frame:04d}.png"), image)


if __name__ == "__main__":
    render_chosen(__doc__, CREATURES, render_creature, preview)
