"""BVH, FBX, glTF, VRM animation and USD through Blender's exporters.

All are Y up, facing +Z in rest: what other programs expect of them, and what Blender's importers take by default.
Unit and names are those of a preset. Joints alone are written, no meshes.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType

import bpy
import numpy as np
from mathutils import Matrix, Vector

from ...core.errors import OutputError, ShotError
from ..scene_io import fcurves
from ..scene_io.body import body_armature
from . import destinations, vrm_animation
from .export_formats import EXPORT_FORMATS
from .export_options import DEFAULTS, ExportOptions
from .export_stage import stage_in_metres, stage_of
from .glb_animation import with_scaled_times
from .whole_files import writing

_ASIDE = 2e-5
"""Radians by which two bones are not in line."""
_SCALED = 0.01
"""Least change of a bone's scale that importers' rounding cannot explain."""
_Y_UP = Matrix(((1, 0, 0, 0), (0, 0, 1, 0), (0, -1, 0, 0), (0, 0, 0, 1)))
Writer = Callable[[Path, bpy.types.Object, bpy.types.Scene, ExportOptions], None]
"""Writes the motion of an armature of a scene to a path."""


def export_performers(scene: bpy.types.Scene, folder: Path, options: ExportOptions = DEFAULTS) -> list[Path]:
    """Write every performer of a scene's shot; see `export_armatures`."""
    return export_armatures(scene, destinations.performers(scene), folder, options)


def export_armatures(
    scene: bpy.types.Scene,
    whose: Sequence[destinations.Named],
    folder: Path,
    options: ExportOptions,
    name: str = "",
) -> list[Path]:
    """Write the motion of some armatures of a scene: NAME.bvh and NAME.fbx, or NAME_PERFORMER.* for several.

    The name is by default the shot's.

    Raises
    ------
    ShotError
        If an armature is gone, or the last frame is before the first.
    OutputError
        If a file cannot be written. Where this Blender lacks an exporter, no file is.
    """
    formats = [suffix for suffix in EXPORT_FORMATS if suffix in options.formats]
    for suffix in formats:
        _check_available(suffix)
    paths: list[Path] = []
    for (owner, armature), stem in zip(whose, destinations.stems(scene, whose, name), strict=True):
        if armature is None:
            raise ShotError("the armature is gone from the scene", where=f"performer {owner}")
        for suffix in formats:
            path = folder / f"{stem}.{suffix}"
            with _naming(paths):
                _WRITERS[suffix](path, armature, scene, options)
            paths.append(path)
    return paths


@contextmanager
def _naming(written: Sequence[Path]) -> Iterator[None]:
    """Add to an error the files that were written before it."""
    try:
        yield
    except OutputError as error:
        if not written:
            raise
        verb = "was" if len(written) == 1 else "were"
        what = f"{error.what}; before it, {', '.join(path.name for path in written)} {verb} written"
        raise OutputError(what, where=error.where, todo=error.todo) from error


def export_bvh(path: Path, armature: bpy.types.Object, scene: bpy.types.Scene, options: ExportOptions) -> None:
    """Write an armature's motion as BVH.

    The root alone has position channels, unless bones below it are moved, too. The frame time has ten digits:
    Blender's six would drift by a frame in minutes at some rates.

    Raises
    ------
    OutputError
        If the file cannot be written, or a bone that carries others is scaled, which a BVH file cannot say.
    """
    if (scaled := _scaled_bone(armature)) is not None:
        raise OutputError(
            f"BVH has no sizes of bones, and {scaled} is scaled",
            where=str(path),
            todo="export FBX alone, or scale the armature object instead of its bone",
        )
    with writing(path) as target:
        with stage_of(armature, scene, _Y_UP, options) as stage:
            bpy.ops.export_anim.bvh(
                filepath=str(target),
                frame_start=stage.frame_start,
                frame_end=stage.frame_end,
                root_transform_only=not _others_move(stage.objects[0]),
            )
            seconds = stage.render.fps_base / stage.render.fps
        text = target.read_text(encoding="utf-8")
        text = re.sub(r"Frame Time: .*", f"Frame Time: {seconds:.10f}", text)
        target.write_text(text, encoding="utf-8", newline="\n")


def _scaled_bone(armature: bpy.types.Object) -> str | None:
    """Return the bone that gives bones with others below them another size, None where they have that of the rest."""
    posed = armature.pose.bones
    scaled = [bone.name for bone in posed if bone.bone.children and _is_scaled(bone.matrix.to_scale())]
    return next((bone.name for bone in posed if _is_scaled(bone.scale)), scaled[0]) if scaled else None


def _is_scaled(scale: Vector) -> bool:
    return bool(np.abs(np.array(scale) - 1).max() > _SCALED)


def _others_move(armature: bpy.types.Object) -> bool:
    """Whether keys move bones that hang on others."""
    bag = fcurves.find_channelbag(armature)
    paths = {curve.data_path for curve in bag.fcurves} if bag is not None else set()
    return any(f"{bone.path_from_id()}.location" in paths for bone in armature.pose.bones if bone.parent is not None)


def export_fbx(path: Path, armature: bpy.types.Object, scene: bpy.types.Scene, options: ExportOptions) -> None:
    """Write an armature's motion as FBX, a key on every frame.

    Raises
    ------
    OutputError
        If the file cannot be written.
    """
    with writing(path) as target, stage_of(armature, scene, Matrix.Identity(4), options) as stage:
        _turn_aside(stage.objects[0])
        _rest_before(stage)
        bpy.ops.export_scene.fbx(
            filepath=str(target),
            use_selection=True,
            object_types={"ARMATURE"},
            bake_anim=True,
            bake_anim_use_all_actions=False,
            bake_anim_use_nla_strips=False,
            bake_anim_simplify_factor=0.0,
            add_leaf_bones=False,
            axis_up="Y",
            axis_forward="-Z",
        )


def _turn_aside(armature: bpy.types.Object) -> None:
    """Turn bones a little aside, so little that it does not count, whose tails Blender's FBX importer would put exactly
    where a bone begins that moves: it would connect that bone, as lone hips to a root, which then could not move.
    """
    bag = fcurves.find_channelbag(armature)
    moved = {curve.data_path for curve in (bag.fcurves if bag is not None else ()) if _changes(curve)}
    aside = set()
    for bone in armature.data.bones:
        above = bone.parent
        if above is None or f"pose.bones{fcurves.property_key(bone.name)}.location" not in moved:
            continue
        reach = float(np.mean([(child.head_local - above.head_local).length for child in above.children]))
        tail = above.head_local + reach * (above.tail_local - above.head_local).normalized()
        if (tail - bone.head_local).length < _ASIDE * reach:
            aside.add(above.name)
    if aside:
        with body_armature.edit_bones(armature) as bones:
            for name in aside:
                bones[name].matrix = bones[name].matrix @ Matrix.Rotation(2 * _ASIDE, 4, "X")


def _changes(curve: bpy.types.FCurve) -> bool:
    values = fcurves.get_keys(curve)["co"][:, 1]
    return bool((values != values[:1]).any())


def _rest_before(stage: bpy.types.Scene) -> None:
    """Show the rest pose on the frame before the first: without a mesh, what is shown becomes the file's rest pose."""
    before = stage.frame_start - 1
    bag = fcurves.find_channelbag(stage.objects[0])
    for curve in bag.fcurves if bag is not None else ():
        attribute = curve.data_path.rpartition(".")[2]
        along = {"scale": (0, 1, 2), "rotation_quaternion": (0,), "rotation_axis_angle": (2,)}.get(attribute, ())
        rest = fcurves.new_keys([before], [float(curve.array_index in along)], "KEYFRAME", "CONSTANT")
        fcurves.set_keys(curve, [rest, fcurves.get_keys(curve)])
    stage.frame_set(before)


def export_glb(path: Path, armature: bpy.types.Object, scene: bpy.types.Scene, options: ExportOptions) -> None:
    """Write an armature's motion as glTF in one file, joints as nodes, a key on every frame.

    The world is in metres, as glTF has it: where a preset has another unit, the armature's node is scaled.

    Raises
    ------
    OutputError
        If the file cannot be written.
    """
    with writing(path) as target, stage_in_metres(armature, scene, options) as stage:
        _write_glb(target, stage)


def export_vrma(path: Path, armature: bpy.types.Object, scene: bpy.types.Scene, options: ExportOptions) -> None:
    """Write an armature's motion as VRM animation: glTF that says which node is which bone of a humanoid.

    It is in metres, and its bones have VRM's names, whatever the preset.

    Raises
    ------
    BodyError
        The armature is not human, or lacks a bone that VRM requires; names it.
    OutputError
        If the file cannot be written.
    """
    bones = vrm_animation.humanoid_bones(armature)
    plain = replace(options, preset="BLENDER")
    with writing(path) as target:
        whole = target.with_suffix(".glb")
        try:
            with stage_of(armature, scene, Matrix.Identity(4), plain) as stage:
                _write_glb(whole, stage)
            target.write_bytes(vrm_animation.as_vrm_animation(whole.read_bytes(), bones))
        finally:
            whole.unlink(missing_ok=True)


def _write_glb(target: Path, stage: bpy.types.Scene) -> None:
    """Write the stage's armature as glTF in one file.

    Blender's exporter takes rates such as 29.97, a whole number over a base, as the number times the base.
    """
    base, stage.render.fps_base = stage.render.fps_base, 1.0
    bpy.ops.export_scene.gltf(
        filepath=str(target),
        export_format="GLB",
        use_active_scene=True,
        use_selection=True,
        export_yup=True,
        export_animations=True,
        export_animation_mode="ACTIVE_ACTIONS",
        export_force_sampling=True,
        export_frame_range=False,
        export_optimize_animation_size=False,
        export_leaf_bone=False,
    )
    if base != 1.0:
        target.write_bytes(with_scaled_times(target.read_bytes(), base))


def export_usd(path: Path, armature: bpy.types.Object, scene: bpy.types.Scene, options: ExportOptions) -> None:
    """Write an armature's motion as USD: a skeleton and its animation, Y up.

    The world is in metres; where a preset has another unit, the skeleton is scaled.

    Raises
    ------
    OutputError
        If the file cannot be written.
    """
    with writing(path) as target, stage_in_metres(armature, scene, options):
        bpy.ops.wm.usd_export(
            filepath=str(target),
            selected_objects_only=True,
            export_animation=True,
            export_armatures=True,
            only_deform_bones=False,
            export_materials=False,
            convert_orientation=True,
            export_global_forward_selection="NEGATIVE_Z",
            export_global_up_selection="Y",
            convert_scene_units="METERS",
            evaluation_mode="RENDER",
        )


_WRITERS: Mapping[str, Writer] = MappingProxyType(
    {"bvh": export_bvh, "fbx": export_fbx, "glb": export_glb, "vrma": export_vrma, "usdc": export_usd}
)
"""The writers of `EXPORT_FORMATS`, by the same names."""


def _check_available(suffix: str) -> None:
    """Check that the exporter of a format is available: some builds lack USD, and add-ons can be disabled."""
    wanted = EXPORT_FORMATS[suffix]
    module, name = wanted.exporter
    if name not in dir(getattr(bpy.ops, module)):
        what = "this Blender has no exporter for this kind of file"
        raise OutputError(what, where=f"*.{suffix}", todo=wanted.remedy)
