"""The scene of an export: a copy of one armature alone, in a preset's unit and names, with a key on every frame."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import bpy
import numpy as np
from mathutils import Matrix

from ...core.errors import BodyError, ShotError
from ...core.numerics.arrays import Array
from ...core.numerics.resampling import sample_times, slerped
from ..retargeting.target_armatures import target_bones
from ..scene_io import fcurves
from ..scene_io.body import body_armature
from ..scene_io.characters import followed_bones
from ..scene_io.review import unknown_bones
from ..scene_io.scene import frame_rate, set_rate
from .export_options import ExportOptions
from .presets import PRESETS

_TRANSFORMS = ("location", "rotation_quaternion", "rotation_euler", "rotation_axis_angle", "scale")


@contextmanager
def stage_of(
    armature: bpy.types.Object, scene: bpy.types.Scene, turn: Matrix, options: ExportOptions
) -> Iterator[bpy.types.Scene]:
    """Provide a temporary scene with nothing but a copy of the armature, active and selected.

    The copy is at the world's origin: the object's transform, the turn and the unit are applied to its bones. Pose
    bones are relative to these, so the keys remain valid but for the unit. The user's scene, selection, frame and
    windows do not change.
    """
    body_armature.object_pose(armature)  # refuses one that is scaled unevenly
    preset = PRESETS[options.preset]
    with _temporary_scene(armature) as (stage, copy):
        first, times = _set_time(stage, scene, options)
        _sample(copy, armature, first, times, options)
        _sample_followed(copy, armature, scene, (first, times), options)
        copy.rename(preset.node or armature.name, mode="ALWAYS")  # the files shall have the armature's name
        _be_plain(copy)
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


@contextmanager
def _temporary_scene(armature: bpy.types.Object) -> Iterator[tuple[bpy.types.Scene, bpy.types.Object]]:
    """Provide an empty scene, and a copy of an armature that is in no scene; both are removed at the end."""
    name, stage = armature.name, bpy.data.scenes.new(armature.name)
    # Some of Blender's exporters turn the window to the scene that they write.
    shown = [(window, window.scene) for window in bpy.context.window_manager.windows]
    copy = armature.copy()
    copy.data = armature.data.copy()
    try:
        yield stage, copy
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


def _be_plain(copy: bpy.types.Object) -> None:
    """Free an object from what shifts it or keeps it from being selected: a parent, delta transforms, being hidden."""
    copy.parent = None
    copy.delta_location = copy.delta_rotation_euler = (0.0, 0.0, 0.0)
    copy.delta_rotation_quaternion, copy.delta_scale = (1.0, 0.0, 0.0, 0.0), (1.0, 1.0, 1.0)
    copy.hide_select = copy.hide_viewport = copy.hide_render = False


@contextmanager
def stage_in_metres(
    armature: bpy.types.Object, scene: bpy.types.Scene, options: ExportOptions
) -> Iterator[bpy.types.Scene]:
    """Provide the scene of an export to a format in metres; if the preset has another unit, the copy is scaled."""
    with stage_of(armature, scene, Matrix.Identity(4), options) as stage:
        stage.objects[0].scale = (1 / PRESETS[options.preset].scale,) * 3
        yield stage


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
    """Set the stage's frames and rate; returns its first frame, and the scene frame that each of its frames shows.

    A shot that begins before frame 0 is exported from there on, as no scene of Blender's has a range that does.
    """
    properties = scene.kfmocap
    first, last = options.frames or (properties.frame_start, properties.frame_start + properties.length - 1)
    if last < first:
        raise ShotError(f"the last frame ({last}) is before the first ({first})", where="Export, frame range")
    rate = frame_rate(scene)
    wanted = options.fps or rate
    times = sample_times(first, last, rate, wanted)
    set_rate(stage, wanted)
    begin = max(first, 0)
    stage.frame_start, stage.frame_end = begin, begin + len(times) - 1
    return begin, times


def _sample(
    copy: bpy.types.Object, armature: bpy.types.Object, first: int, times: Array, options: ExportOptions
) -> None:
    """Key the copy of an armature on every frame from `first` on, with the poses at the scene frames `times`."""
    bag = fcurves.find_channelbag(armature)
    if bag is None:
        return
    frames = np.arange(np.floor(times[0]), np.ceil(times[-1]) + 1)
    values = {
        (curve.data_path, curve.array_index): np.array([curve.evaluate(frame) for frame in frames])
        for curve in bag.fcurves
        if curve.data_path.rpartition(".")[2] in _TRANSFORMS and len(curve.keyframe_points)
    }
    for bone in armature.pose.bones:
        values = {key: np.full(len(frames), value) for key, value in _standing(bone).items()} | values
    unit = PRESETS[options.preset].scale * body_armature.object_pose(armature)[2]
    _scale_locations(values, armature, unit, options.root_motion)
    copy.animation_data.action = bpy.data.actions.new(armature.name)
    sampled = fcurves.ensure_channelbag(copy, armature.name)
    for (path, index), row in _at_times(values, frames, times).items():
        keys = fcurves.new_keys(first + np.arange(len(times)), row, "KEYFRAME", "LINEAR")
        fcurves.set_keys(fcurves.ensure_fcurve(sampled, path, index, armature.name), [keys])


def _standing(bone: bpy.types.PoseBone) -> dict[tuple[str, int], float]:
    """Return the channels that pose a bone, by path and index; none where it is at rest."""
    if np.allclose(np.array(bone.matrix_basis), np.eye(4), atol=1e-6):
        return {}
    turn = {"QUATERNION": "rotation_quaternion", "AXIS_ANGLE": "rotation_axis_angle"}.get(
        bone.rotation_mode, "rotation_euler"
    )
    return {
        (bone.path_from_id(attribute), index): value
        for attribute in ("location", turn, "scale")
        for index, value in enumerate(getattr(bone, attribute))
    }


def _sample_followed(
    copy: bpy.types.Object,
    armature: bpy.types.Object,
    scene: bpy.types.Scene,
    frames: tuple[int, Array],
    options: ExportOptions,
) -> None:
    """Replace constraints and drivers on the copy of a rig by keys with their effect.

    They would follow the rig itself, which is in another scene, and is not rotated and scaled like the copy.
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
    """Resample curves by path and index at other times: quaternions by slerp, all others linearly."""
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
    """Convert locations to another unit, in place; without root motion the hips stay over their first position."""
    if not root_motion:
        _stay_in_place(values, armature)
    for (path, index), row in values.items():
        if path.endswith(".location"):
            values[path, index] = scale * row


def _stay_in_place(values: dict[tuple[str, int], Array], armature: bpy.types.Object) -> None:
    """Take the horizontal way of the hips, or of what carries them, away from all bones that move through the world."""
    paths = {bone.name: bone.path_from_id("location") for bone in armature.pose.bones}
    there = [name for name, path in paths.items() if all((path, k) in values for k in range(3))]
    moved = {name for name in there if any(np.ptp(values[paths[name], k]) for k in range(3))}
    posed: Any = armature.pose.bones
    tops = [
        name
        for name in there
        if name in moved and not any(above.name in moved for above in posed[name].parent_recursive)
    ]
    hips = posed[_hips_of(armature)]
    carrier = next((each.name for each in (hips, *hips.parent_recursive) if each.name in tops), None)
    if carrier is None:
        return
    ways = {name: np.stack([values[paths[name], k] for k in range(3)], axis=1) for name in tops}
    aside = ways[carrier] @ _location_axes(armature, carrier).T * [1.0, 1.0, 0.0]
    for name, way in ways.items():
        stays = way - (aside - aside[0]) @ _location_axes(armature, name)
        values.update({(paths[name], k): row for k, row in enumerate(stays.T)})


def _hips_of(armature: bpy.types.Object) -> str:
    """Return the topmost bone of a body, or the hips of a character."""
    try:
        return body_armature.body_bones(armature)[0].name
    except BodyError:
        return target_bones(armature).bones["hips"][0]


def _location_axes(armature: bpy.types.Object, name: str) -> Array:
    """Return the directions in the world of a bone's location channels, as columns."""
    bone: Any = armature.pose.bones[name]
    axes = armature.matrix_world
    if bone.parent is not None:
        axes = axes @ bone.parent.matrix @ bone.parent.bone.matrix_local.inverted()
    if bone.bone.use_local_location:
        axes = axes @ bone.bone.matrix_local
    return np.array(axes.to_3x3().normalized())
