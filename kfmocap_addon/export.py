"""BVH and FBX through Blender's exporters.

Both are Y up, in metres, facing +Z in rest: what other programs expect of them, and what Blender's importers
take by default. Joints alone are written, no meshes.
"""

from __future__ import annotations

import contextlib
import io
import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import bpy
from mathutils import Matrix

from ..core.errors import OutputError, ShotError
from ..core.formats.files import replacing
from ..core.formats.shot_toml import shot_name
from . import rig

_Y_UP = Matrix(((1, 0, 0, 0), (0, 0, 1, 0), (0, -1, 0, 0), (0, 0, 0, 1)))


def export_performers(scene: bpy.types.Scene, folder: Path, *, bvh: bool = True, fbx: bool = True) -> list[Path]:
    """Write every performer of a scene's shot: NAME.bvh and NAME.fbx, or NAME_performer.* for several.

    Raises
    ------
    OutputError
        If a file cannot be written.
    """
    performers = scene.kfmocap.performers
    writers = [(".bvh", export_bvh)] * bvh + [(".fbx", export_fbx)] * fbx
    paths = []
    for slot in performers:
        if slot.armature is None:
            raise ShotError("the armature is gone from the scene", where=f"performer {slot.name}")
        name = scene.kfmocap.shot if len(performers) == 1 else f"{scene.kfmocap.shot}_{slot.name}"
        name = shot_name(name, f"scene {scene.name}")
        for suffix, writer in writers:
            paths.append(folder / f"{name}{suffix}")
            writer(paths[-1], slot.armature, scene)
    return paths


def export_bvh(path: Path, armature: bpy.types.Object, scene: bpy.types.Scene) -> None:
    """Write an armature's motion over the shot's frames as BVH.

    The root alone has position channels. The frame time has ten digits: Blender's six would drift by a frame
    in minutes at some rates.

    Raises
    ------
    OutputError
        If the file cannot be written.
    """
    with writing(path) as target:
        with _stage(armature, scene, _Y_UP) as stage:
            bpy.ops.export_anim.bvh(
                filepath=str(target),
                frame_start=stage.frame_start,
                frame_end=stage.frame_end,
                root_transform_only=True,
            )
        seconds = scene.render.fps_base / scene.render.fps
        text = target.read_text(encoding="utf-8")
        text = re.sub(r"Frame Time: .*", f"Frame Time: {seconds:.10f}", text)
        target.write_text(text, encoding="utf-8", newline="\n")


def export_fbx(path: Path, armature: bpy.types.Object, scene: bpy.types.Scene) -> None:
    """Write an armature's motion over the shot's frames as FBX, a key on every frame.

    Raises
    ------
    OutputError
        If the file cannot be written.
    """
    with writing(path) as target, _stage(armature, scene, Matrix.Identity(4)):
        bpy.ops.export_scene.fbx(
            filepath=str(target),
            use_selection=True,
            object_types={"ARMATURE"},
            bake_anim=True,
            bake_anim_use_all_actions=False,
            bake_anim_use_nla_strips=False,
            bake_anim_simplify_factor=0.0,
            add_leaf_bones=False,
        )


@contextmanager
def _stage(armature: bpy.types.Object, scene: bpy.types.Scene, turn: Matrix) -> Iterator[bpy.types.Scene]:
    """A scene for the time of an export, with nothing but a copy of the armature, active and selected.

    The copy stands at the world's origin: where the object was, and the turn, have gone into its bones. Pose
    bones are relative to them, so the keys hold as they are. The user's scene, selection and frame stay.
    """
    rig.object_pose(armature)  # refuses a scaled one
    name, stage = armature.name, bpy.data.scenes.new(armature.name)
    properties = scene.kfmocap
    stage.render.fps, stage.render.fps_base = scene.render.fps, scene.render.fps_base
    stage.frame_start = properties.frame_start
    stage.frame_end = properties.frame_start + properties.length - 1
    copy = armature.copy()
    copy.data = armature.data.copy()
    try:
        copy.rename(name, mode="ALWAYS")  # the files shall have the armature's name
        copy.parent = None
        copy.data.transform(turn @ armature.matrix_world)
        copy.matrix_world = Matrix.Identity(4)
        stage.collection.objects.link(copy)
        layer = stage.view_layers[0]
        copy.select_set(True, view_layer=layer)
        layer.objects.active = copy
        with bpy.context.temp_override(
            scene=stage,
            view_layer=layer,
            object=copy,
            active_object=copy,
            selected_objects=[copy],
        ):
            yield stage
    finally:
        bpy.data.armatures.remove(copy.data)
        bpy.data.scenes.remove(stage)
        armature.rename(name, mode="ALWAYS")


@contextmanager
def writing(path: Path) -> Iterator[Path]:
    """`replacing`, with the folder made where it is missing and Blender's failures told as ours.

    Blender's exporters also print; that is not for the user of a batch.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OutputError(f"the folder cannot be made: {error.strerror}", where=str(path.parent)) from error
    with replacing(path) as target, contextlib.redirect_stdout(io.StringIO()):
        try:
            yield target
        except RuntimeError as error:
            raise OutputError(f"Blender cannot write it: {error}", where=str(path)) from error
