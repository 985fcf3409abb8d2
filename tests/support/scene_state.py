"""A Blender file as plain values: two are equal where the file is the same to the last bit."""

from __future__ import annotations

import ctypes
from collections.abc import Mapping
from functools import cache
from typing import Any

import bpy
import numpy as np
from kfmocap.kfmocap_addon.operators.performers.edit_body import LENGTHS

PROPERTIES = ("kfmocap", "kfmocap_capture")
POSED = {"location": 3, "rotation_quaternion": 4, "scale": 3}
RESTING = {"head_local": 3, "tail_local": 3}
"""Attributes of bones in a pose and at rest, and how many numbers each has."""
MEASURES = {"height", *LENGTHS}
"""Properties of performers that are measured on bones and meshes, which are compared themselves."""


def state() -> dict[str, Any]:
    """What tools change: keys, poses, places, meshes, our properties of scenes, and custom properties."""
    return {
        "scenes": {s.name: _scene(s) for s in bpy.data.scenes},
        "actions": {a.name: (_action(a), _custom(a)) for a in bpy.data.actions},
        "objects": {o.name: _object(o) for o in bpy.data.objects},
        "meshes": {m.name: _mesh(m) for m in bpy.data.meshes},
        "cameras": {
            c.name: (c.lens, c.shift_x, c.shift_y, [b.clip and b.clip.name for b in c.background_images])
            for c in bpy.data.cameras
        },
        "clips": {c.name: (c.filepath, c.frame_start, c.tracking.camera.k1) for c in bpy.data.movieclips},
    }


def differences(a: Any, b: Any, where: str = "") -> list[str]:
    """Where two states differ."""
    if a == b:
        return []
    if isinstance(a, dict) and isinstance(b, dict):
        return [d for k in {**a, **b} for d in differences(a.get(k, "nothing"), b.get(k, "nothing"), f"{where}/{k}")]
    if isinstance(a, tuple) and isinstance(b, tuple) and len(a) == len(b):
        return [d for i, (x, y) in enumerate(zip(a, b, strict=True)) for d in differences(x, y, f"{where}[{i}]")]
    return [f"{where}: {str(a)[:200]} != {str(b)[:200]}"]


def _scene(scene: bpy.types.Scene) -> tuple[Any, ...]:
    render = scene.render
    return (
        (scene.frame_current, scene.frame_start, scene.frame_end, scene.camera and scene.camera.name),
        (render.resolution_x, render.resolution_y, render.pixel_aspect_x, render.fps, render.fps_base),
        tuple(sorted(o.name for o in scene.objects)),
        {name: _group(getattr(scene, name)) for name in PROPERTIES},
        _custom(scene),
    )


def _group(group: bpy.types.PropertyGroup) -> dict[str, Any]:
    found: dict[str, Any] = {}
    for name, kind, is_array in _items(type(group)):
        value = getattr(group, name)
        if kind == "COLLECTION":
            found[name] = tuple(_group(one) for one in value)
        elif kind == "POINTER":
            is_group = isinstance(value, bpy.types.PropertyGroup)
            found[name] = _group(value) if is_group else value and value.name
        else:
            found[name] = tuple(value) if is_array else value
    return found


@cache
def _items(kind: type[bpy.types.PropertyGroup]) -> tuple[tuple[str, str, bool], ...]:
    """Name and type of each property of a group that is compared, and whether it is an array."""
    items = [item for item in kind.bl_rna.properties if item.identifier not in {"rna_type", *MEASURES}]
    return tuple((item.identifier, item.type, getattr(item, "is_array", False)) for item in items)


def _action(action: bpy.types.Action) -> dict[Any, Any]:
    bags = [bag for layer in action.layers for strip in layer.strips for bag in strip.channelbags]
    return {
        (bag.slot_handle, curve.data_path, curve.array_index): (_keys(curve), curve.lock)
        for bag in bags
        for curve in bag.fcurves
    }


def _keys(curve: bpy.types.FCurve) -> bytes:
    """All that the keys of a curve hold: Blender's own memory, in which they lie one behind the other."""
    points = curve.keyframe_points
    return ctypes.string_at(points[0].as_pointer(), _key_size() * len(points)) if len(points) else b""


@cache
def _key_size() -> int:
    """Bytes from one key of a curve to the next in Blender's memory."""
    action = bpy.data.actions.new("two keys")
    strip = action.layers.new("Layer").strips.new(type="KEYFRAME")
    curve = strip.channelbag(action.slots.new("OBJECT", "two keys"), ensure=True).fcurves.new("location")
    curve.keyframe_points.add(2)
    size = curve.keyframe_points[1].as_pointer() - curve.keyframe_points[0].as_pointer()
    bpy.data.actions.remove(action)
    return size


def _object(thing: bpy.types.Object) -> tuple[Any, ...]:
    bones = {bone.name: (bone.rotation_mode, _custom(bone)) for bone in (thing.pose.bones if thing.pose else ())}
    drivers = thing.animation_data.drivers if thing.animation_data else ()
    return (
        tuple(map(tuple, thing.matrix_basis)),
        (thing.parent and thing.parent.name, thing.parent_bone, thing.display_type, thing.hide_select),
        tuple(thing.color),
        thing.animation_data and thing.animation_data.action and thing.animation_data.action.name,
        tuple((d.data_path, d.array_index, d.driver.expression) for d in drivers),
        bones,
        _numbers(thing.pose.bones, POSED) if thing.pose else (),
        _custom(thing),
        _rest(thing),
    )


def _rest(thing: bpy.types.Object) -> dict[str, Any]:
    if thing.type != "ARMATURE":
        return {}
    return {
        "places": _numbers(thing.data.bones, RESTING),
        **{bone.name: _custom(bone) for bone in thing.data.bones},
    }


def _numbers(bones: bpy.types.bpy_prop_collection, sizes: Mapping[str, int]) -> tuple[bytes, ...]:
    """Numbers of all bones, one behind the other, by attribute."""
    found = []
    for name, size in sizes.items():
        numbers = np.empty(size * len(bones), np.float32)
        bones.foreach_get(name, numbers)
        found.append(numbers.tobytes())
    return tuple(found)


def _mesh(mesh: bpy.types.Mesh) -> tuple[Any, ...]:
    points = np.empty(3 * len(mesh.vertices), np.float32)
    mesh.vertices.foreach_get("co", points)
    corners = np.empty(len(mesh.loops), np.int32)
    mesh.loops.foreach_get("vertex_index", corners)
    starts = np.empty(len(mesh.polygons), np.int32)
    mesh.polygons.foreach_get("loop_start", starts)
    return points.tobytes(), corners.tobytes(), starts.tobytes()


def _custom(owner: Any) -> dict[str, str]:
    """Custom properties, without those that are properties of ours and compared as such."""
    return {k: _plain(owner[k]) for k in owner.keys() if k not in PROPERTIES}  # noqa: SIM118 (bones are no mappings)


def _plain(value: Any) -> Any:
    """The value of a custom property: a group as a dictionary, an array as its bytes."""
    if hasattr(value, "to_dict"):
        return {key: _plain(value[key]) for key in value.keys()}  # noqa: SIM118
    return np.array(value).tobytes() if hasattr(value, "to_list") else str(value)
