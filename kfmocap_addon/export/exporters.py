"""BVH, FBX, glTF, VRM animation and USD through Blender's exporters.

All are Y up, facing +Z in rest: what other programs expect of them, and what Blender's importers take by default.
Unit and names are those of a preset. Joints alone are written, no meshes.
"""

from __future__ import annotations

import contextlib
import io
import re
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType

import bpy
import numpy as np
from mathutils import Matrix

from ...core.errors import OutputError, ShotError
from ...core.numerics.arrays import Array
from ...core.numerics.resampling import sample_times, slerped
from ...core.runtime.files import replacing
from ..scene_io import body_armature, body_channels, fcurves, followed_bones, unknown_bones
from ..scene_io.scene import set_rate
from . import destinations, vrm_animation
from .presets import PRESETS
from .whole_files import check_whole

_Y_UP = Matrix(((1, 0, 0, 0), (0, 0, 1, 0), (0, -1, 0, 0), (0, 0, 0, 1)))
_TRANSFORMS = ("location", "rotation_quaternion", "rotation_euler", "rotation_axis_angle", "scale")
_GLTF = ("export_scene", "gltf", "enable the add-on glTF 2.0 format under Edit > Preferences > Add-ons")
_EXPORTERS = MappingProxyType(
    {
        ".bvh": ("export_anim", "bvh", "enable the add-on BVH format under Edit > Preferences > Add-ons"),
        ".fbx": ("export_scene", "fbx", "enable the add-on FBX format under Edit > Preferences > Add-ons"),
        ".glb": _GLTF,
        ".vrma": _GLTF,
        ".usdc": ("wm", "usd_export", "choose other kinds of files, or use a Blender that was built with USD"),
    }
)
"""The operator that writes a kind of file, and what to do where it is missing."""


@dataclass(frozen=True)
class ExportOptions:
    """What to write of the performers.

    Attributes
    ----------
    preset : str
        See `export_presets.PRESETS`.
    bvh, fbx, glb : bool
        Which files; glb is glTF in one file.
    frames : tuple of int, optional
        First and last scene frame; by default those of the shot.
    fps : float, optional
        Frames per second of the files; by default the scene's.
    root_motion : bool
        The performers move through the world; else they stay over their first place, and only rise and sink.
    leave_out_unknown : bool
        Without the bones of parts that nothing has shown, but for those that others hang on.
    vrma, usd : bool
        VRM animation, and USD in binary (.usdc).
    """

    preset: str = "BLENDER"
    bvh: bool = True
    fbx: bool = True
    frames: tuple[int, int] | None = None
    fps: float | None = None
    root_motion: bool = True
    glb: bool = False
    leave_out_unknown: bool = False
    vrma: bool = False
    usd: bool = False


def export_performers(
    scene: bpy.types.Scene, folder: Path, options: ExportOptions = ExportOptions(), name: str = ""
) -> list[Path]:
    """Write every performer of a scene's shot: NAME.bvh and NAME.fbx, or NAME_PERFORMER.* for several.

    The name is by default the shot's.

    Raises
    ------
    ShotError
        If an armature is gone, or the last frame is before the first.
    OutputError
        If a file cannot be written. Where this Blender lacks an exporter, no file is.
    """
    performers = scene.kfmocap.performers
    writers = [(".bvh", export_bvh)] * options.bvh + [(".fbx", export_fbx)] * options.fbx
    writers += [(".glb", export_glb)] * options.glb
    writers += [(".vrma", export_vrma)] * options.vrma + [(".usdc", export_usd)] * options.usd
    for suffix, _ in writers:
        _check_available(Path(f"*{suffix}"))  # before anything is written
    paths = []
    for slot, stem in zip(performers, destinations.stems(scene, name), strict=True):
        if slot.armature is None:
            raise ShotError("the armature is gone from the scene", where=f"performer {slot.name}")
        for suffix, writer in writers:
            paths.append(folder / f"{stem}{suffix}")
            writer(paths[-1], slot.armature, scene, options)
    return paths


def export_bvh(
    path: Path, armature: bpy.types.Object, scene: bpy.types.Scene, options: ExportOptions = ExportOptions()
) -> None:
    """Write an armature's motion as BVH.

    The root alone has position channels, unless bones below it are moved, too. The frame time has ten digits:
    Blender's six would drift by a frame in minutes at some rates.

    Raises
    ------
    OutputError
        If the file cannot be written.
    """
    with writing(path) as target:
        with _stage(armature, scene, _Y_UP, options) as stage:
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


def _others_move(armature: bpy.types.Object) -> bool:
    """Whether keys move bones that hang on others."""
    bag = fcurves.find_channelbag(armature)
    paths = {curve.data_path for curve in bag.fcurves} if bag is not None else set()
    return any(f"{bone.path_from_id()}.location" in paths for bone in armature.pose.bones if bone.parent is not None)


def export_fbx(
    path: Path, armature: bpy.types.Object, scene: bpy.types.Scene, options: ExportOptions = ExportOptions()
) -> None:
    """Write an armature's motion as FBX, a key on every frame.

    Raises
    ------
    OutputError
        If the file cannot be written.
    """
    with writing(path) as target, _stage(armature, scene, Matrix.Identity(4), options) as stage:
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


def export_glb(
    path: Path, armature: bpy.types.Object, scene: bpy.types.Scene, options: ExportOptions = ExportOptions()
) -> None:
    """Write an armature's motion as glTF in one file, joints as nodes, a key on every frame.

    The world is in metres, as glTF has it: where a preset has another unit, the armature's node is scaled.

    Raises
    ------
    OutputError
        If the file cannot be written.
    """
    with writing(path) as target, _stage_in_metres(armature, scene, options):
        _write_glb(target)


def export_vrma(
    path: Path, armature: bpy.types.Object, scene: bpy.types.Scene, options: ExportOptions = ExportOptions()
) -> None:
    """Write an armature's motion as VRM animation: glTF that says which node is which bone of a humanoid.

    It is in metres, and its bones have VRM's names, whatever the preset.

    Raises
    ------
    BodyError
        The armature is no human's, or lacks a bone that VRM requires; names it.
    OutputError
        If the file cannot be written.
    """
    bones = vrm_animation.humanoid_bones(armature)
    plain = replace(options, preset="BLENDER")
    with writing(path) as target:
        whole = target.with_suffix(".glb")
        try:
            with _stage(armature, scene, Matrix.Identity(4), plain):
                _write_glb(whole)
            target.write_bytes(vrm_animation.as_vrm_animation(whole.read_bytes(), bones))
        finally:
            whole.unlink(missing_ok=True)


def _write_glb(target: Path) -> None:
    """Write the stage's armature as glTF in one file."""
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


def export_usd(
    path: Path, armature: bpy.types.Object, scene: bpy.types.Scene, options: ExportOptions = ExportOptions()
) -> None:
    """Write an armature's motion as USD: a skeleton and its animation, Y up.

    The world is in metres; where a preset has another unit, the skeleton is scaled.

    Raises
    ------
    OutputError
        If the file cannot be written.
    """
    with writing(path) as target, _stage_in_metres(armature, scene, options):
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


@contextmanager
def _stage_in_metres(
    armature: bpy.types.Object, scene: bpy.types.Scene, options: ExportOptions
) -> Iterator[bpy.types.Scene]:
    """The scene of an export to a format in metres: where a preset has another unit, the copy is scaled."""
    with _stage(armature, scene, Matrix.Identity(4), options) as stage:
        stage.objects[0].scale = (1 / PRESETS[options.preset].scale,) * 3
        yield stage


@contextmanager
def _stage(
    armature: bpy.types.Object, scene: bpy.types.Scene, turn: Matrix, options: ExportOptions
) -> Iterator[bpy.types.Scene]:
    """A scene for the time of an export, with nothing but a copy of the armature, active and selected.

    The copy stands at the world's origin: where the object was, the turn, and the unit have gone into its bones. Pose
    bones are relative to them, so the keys hold but for the unit. The user's scene, selection and frame stay, and
    what windows show.
    """
    body_armature.object_pose(armature)  # refuses one that is scaled unevenly
    preset = PRESETS[options.preset]
    name, stage = armature.name, bpy.data.scenes.new(armature.name)
    # Some of Blender's exporters turn the window to the scene that they write.
    shown = [(window, window.scene) for window in bpy.context.window_manager.windows]
    copy = armature.copy()
    copy.data = armature.data.copy()
    try:
        first, times = _set_time(stage, scene, options)
        _sample(copy, armature, first, times, options)
        _sample_followed(copy, armature, scene, (first, times), options)
        copy.rename(preset.node or name, mode="ALWAYS")  # the files shall have the armature's name
        copy.parent = None
        copy.data.transform(Matrix.Scale(preset.scale, 4) @ turn @ armature.matrix_world)
        copy.matrix_world = Matrix.Identity(4)
        stage.collection.objects.link(copy)
        if options.leave_out_unknown:
            _leave_out_unknown(copy)
        for bone in copy.data.bones:
            bone.name = preset.names.get(bone.name, bone.name)
        stage.unit_settings.scale_length = 1 / preset.scale
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
        for window, showed in shown:
            if window.scene != showed:
                window.scene = showed
        sampled = fcurves.find_channelbag(copy) and copy.animation_data.action
        if sampled and sampled != armature.animation_data.action:
            bpy.data.actions.remove(sampled)
        bpy.data.armatures.remove(copy.data)
        bpy.data.scenes.remove(stage)
        armature.rename(name, mode="ALWAYS")


def _leave_out_unknown(copy: bpy.types.Object) -> None:
    """Remove the bones of unknown parts from the copy of an armature, and those of all that hangs on them alone."""
    unknown = {bone.name for bone in copy.pose.bones if bone.get(unknown_bones.UNKNOWN, 0)}
    gone = {
        bone.name
        for bone in copy.data.bones
        if bone.name in unknown and {child.name for child in bone.children_recursive} <= unknown
    }
    with body_armature.edit_bones(copy) as bones:
        for name in gone:
            bones.remove(bones[name])


def _set_time(stage: bpy.types.Scene, scene: bpy.types.Scene, options: ExportOptions) -> tuple[int, Array]:
    """Give the stage its frames and rate; returns its first frame, and the scene frame that each of them shows."""
    properties = scene.kfmocap
    first, last = options.frames or (properties.frame_start, properties.frame_start + properties.length - 1)
    if last < first:
        raise ShotError(f"the last frame ({last}) is before the first ({first})", where="Export, frame range")
    rate = scene.render.fps / scene.render.fps_base
    wanted = options.fps or rate
    times = sample_times(first, last, rate, wanted)
    set_rate(stage, wanted)
    stage.frame_start, stage.frame_end = first, first + len(times) - 1
    return first, times


def _sample(
    copy: bpy.types.Object, armature: bpy.types.Object, first: int, times: Array, options: ExportOptions
) -> None:
    """Give the copy of an armature a key on every frame from the first on, of the scene frames `times`."""
    bag = fcurves.find_channelbag(armature)
    if bag is None:
        return
    frames = np.arange(np.floor(times[0]), np.ceil(times[-1]) + 1)
    values = {
        (curve.data_path, curve.array_index): np.array([curve.evaluate(frame) for frame in frames])
        for curve in bag.fcurves
        if curve.data_path.rpartition(".")[2] in _TRANSFORMS and len(curve.keyframe_points)
    }
    unit = PRESETS[options.preset].scale * body_armature.object_pose(armature)[2]
    _scale_locations(values, armature, unit, options.root_motion)
    copy.animation_data.action = bpy.data.actions.new(armature.name)
    sampled = fcurves.ensure_channelbag(copy, armature.name)
    for (path, index), row in _at_times(values, frames, times).items():
        keys = fcurves.new_keys(first + np.arange(len(times)), row, "KEYFRAME", "LINEAR")
        fcurves.set_keys(fcurves.ensure_fcurve(sampled, path, index, armature.name), [keys])


def _sample_followed(
    copy: bpy.types.Object,
    armature: bpy.types.Object,
    scene: bpy.types.Scene,
    frames: tuple[int, Array],
    options: ExportOptions,
) -> None:
    """Give bones of the copy of a rig that constraints or drivers move keys of what they do, in place of these.

    They would follow the rig itself, which is in another scene, and is not turned and scaled as the copy.
    """
    followed = followed_bones.following(armature)
    data = copy.animation_data
    if not followed or data is None or data.action is None:
        return
    first, times = frames
    for driver in list(data.drivers):
        data.drivers.remove(driver)
    for bone in copy.pose.bones:
        for constraint in list(bone.constraints):
            bone.constraints.remove(constraint)
    bag = fcurves.ensure_channelbag(copy, armature.name)
    unit = PRESETS[options.preset].scale * body_armature.object_pose(armature)[2]
    for name, (place, turn, size) in followed_bones.read_followed(scene, armature, followed, times).items():
        bone = copy.pose.bones[name]
        bone.rotation_mode = "QUATERNION"
        for attribute, values in (("location", unit * place), ("rotation_quaternion", turn), ("scale", size)):
            path = bone.path_from_id(attribute)
            for index, row in enumerate(values.T):
                keys = fcurves.new_keys(first + np.arange(len(times)), row, "KEYFRAME", "LINEAR")
                fcurves.set_keys(fcurves.ensure_fcurve(bag, path, index, armature.name), [keys])


def _at_times(values: dict[tuple[str, int], Array], frames: Array, times: Array) -> dict[tuple[str, int], Array]:
    """Curves by path and index, at other times: whole quaternions by slerp, all else linearly."""
    found = {}
    for (path, index), row in values.items():
        together = [values.get((path, k)) for k in range(4)]
        if path.endswith("rotation_quaternion") and all(part is not None for part in together):
            found[path, index] = slerped(np.stack(together, axis=1), frames, times)[:, index]
        else:
            found[path, index] = np.interp(times, frames, row)
    return found


def _scale_locations(
    values: dict[tuple[str, int], Array], armature: bpy.types.Object, scale: float, root_motion: bool
) -> None:
    """Bring locations to another unit, in place; without root motion the root stays over its first place."""
    if not root_motion:
        root = armature.pose.bones[body_armature.body_bones(armature)[0].name]
        path = f"{root.path_from_id()}.location"
        rows = [values.get((path, k)) for k in range(3)]
        if all(row is not None for row in rows):
            axes = body_channels.root_frame(armature)[0]
            world = np.stack(rows, axis=1) @ axes.T
            world[:, :2] = world[0, :2]
            values.update({(path, k): row for k, row in enumerate((world @ axes).T)})
    for (path, index), row in values.items():
        if path.endswith(".location"):
            values[path, index] = scale * row


@contextmanager
def writing(path: Path) -> Iterator[Path]:
    """Like `replacing`; makes the folder where it is missing, and raises Blender's failures as OutputError, also those
    that it does not report: see `check_whole`.

    Blender's exporters also print, and tracebacks where they fail; that is not for the user of a batch.
    """
    _check_available(path)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OutputError(f"the folder cannot be made: {error.strerror}", where=str(path.parent)) from error
    printed = io.StringIO()
    with replacing(path) as target, contextlib.redirect_stdout(printed), contextlib.redirect_stderr(printed):
        try:
            yield target
        except RuntimeError as error:
            raise OutputError(f"Blender cannot write it: {_reason(error)}", where=str(path)) from error
        check_whole(target, path)


def _check_available(path: Path) -> None:
    """See that this Blender has the exporter for a kind of file: some builds lack USD, and add-ons can be disabled."""
    if path.suffix not in _EXPORTERS:
        return
    module, name, todo = _EXPORTERS[path.suffix]
    if name not in dir(getattr(bpy.ops, module)):
        raise OutputError("this Blender has no exporter for this kind of file", where=str(path), todo=todo)


def _reason(error: RuntimeError) -> str:
    """What an operator failed with: where that was an exception in Python, Blender gives its traceback instead."""
    said = str(error).partition("\nLocation:")[0].strip()
    return said.splitlines()[-1] if "Traceback" in said else said
