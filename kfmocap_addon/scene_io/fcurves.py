"""Keys of layered actions as arrays: the one path that holds from Blender 4.5 on."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

import bpy
import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...core.numerics.arrays import Array

_MAX_TABLE_FRAMES = 100_000  # frames: a table of as many is made faster than numbers are sorted
Keys = NDArray[np.void]
"""Keys of one F-curve, shape (K,), with a field for every property of a Blender key."""

KEY_TYPE = np.dtype(
    [
        ("co", np.float32, 2),
        ("handle_left", np.float32, 2),
        ("handle_right", np.float32, 2),
        ("handle_left_type", np.int32),
        ("handle_right_type", np.int32),
        ("interpolation", np.int32),
        ("type", np.int32),
        ("easing", np.int32),
        ("back", np.float32),
        ("amplitude", np.float32),
        ("period", np.float32),
        ("select_control_point", np.bool_),
        ("select_left_handle", np.bool_),
        ("select_right_handle", np.bool_),
    ]
)


_BONE = re.compile(r'pose\.bones\["((?:[^"\\]|\\.)*)"\]')
_CONSTRAINT = re.compile(rf'{_BONE.pattern}\.constraints\["((?:[^"\\]|\\.)*)"\]')
_PROPERTY = re.compile(rf'(?:{_BONE.pattern})?\["((?:[^"\\]|\\.)*)"\]')
_ENDS = np.cumsum([KEY_TYPE[name].itemsize for name in KEY_TYPE.names or ()]).tolist()
_BYTES = MappingProxyType(
    {name: slice(end - KEY_TYPE[name].itemsize, end) for name, end in zip(KEY_TYPE.names or (), _ENDS, strict=True)}
)
"""Where the fields of a key lie in its bytes."""
_FIELD_OF_BYTE = np.repeat(list(_BYTES), [place.stop - place.start for place in _BYTES.values()])
"""To which field each byte of a key belongs."""
PLACES = np.dtype([("co", np.float32, 2), ("type", np.int32)])
"""What is read of keys where nobody writes them again: frame, value and type."""
_ENUMS = MappingProxyType(
    {
        item.identifier: MappingProxyType({choice.identifier: choice.value for choice in item.enum_items})
        for item in bpy.types.Keyframe.bl_rna.properties
        if item.type == "ENUM"
    }
)


@dataclass(frozen=True, eq=False)
class BoneAttribute:
    """An attribute of a pose bone that is animated, such as its location; without a bone, of the armature object."""

    bone: str
    attribute: str

    @property
    def path(self) -> str:
        """The data path of the attribute in the armature object."""
        return bone_path(self.bone, self.attribute) if self.bone else self.attribute


def bone_path(bone: str, attribute: str = "") -> str:
    """Return the data path of a pose bone's attribute, or of a custom property such as `["name"]`, in the armature
    object.
    """
    dot = "" if attribute.startswith("[") else "."
    return f'pose.bones["{bpy.utils.escape_identifier(bone)}"]{dot}{attribute}'


def bone_of(path: str) -> str:
    """Return the name of the bone whose attribute a data path leads to, empty if it leads elsewhere."""
    found = _BONE.match(path)
    return bpy.utils.unescape_identifier(found.group(1)) if found else ""


def constraint_of(path: str) -> str:
    """Return the name of the bone's constraint that a data path leads to or into, empty if it leads elsewhere."""
    found = _CONSTRAINT.match(path)
    return bpy.utils.unescape_identifier(found.group(2)) if found else ""


def custom_property_of(path: str) -> tuple[str, str]:
    """Return the bone, empty where it is the data-block itself, and the name of the custom property that a data path
    leads to; the name is empty where it leads elsewhere.
    """
    found = _PROPERTY.fullmatch(path)
    bone, name = (bpy.utils.unescape_identifier(text or "") for text in found.groups()) if found else ("", "")
    return bone, name


def property_key(name: str) -> str:
    """Return a custom property as the end of a data path."""
    return f'["{bpy.utils.escape_identifier(name)}"]'


def enum_value(field: str, name: str) -> int:
    """Number of an enum item of a key's property, as `foreach_set` takes it."""
    return _ENUMS[field][name]


def own_animation(owner: bpy.types.Object) -> bpy.types.AnimData:
    """Return the object's animation data, made where it is missing.

    A strip that is being edited is left: until then its action stands in the place of the object's own.
    """
    data = owner.animation_data or owner.animation_data_create()
    if data.use_tweak_mode:  # setting it evaluates the animation anew, and undoes what was posed
        data.use_tweak_mode = False
    return data


def unlink_action(owner: bpy.types.Object) -> None:
    """Give an object a copy of its action where that is linked from another file: no key of a linked one is saved."""
    data = owner.animation_data
    if data is not None and data.action is not None and data.action.library is not None:
        slot = data.action_slot
        data.action = data.action.copy()
        if slot is not None:
            data.action_slot = next(each for each in data.action.slots if each.handle == slot.handle)


def ensure_action(owner: bpy.types.Object, name: str) -> bpy.types.Action:
    """Return the object's action with a slot for the object, made where it is missing."""
    data = own_animation(owner)
    if data.action is None:
        data.action = bpy.data.actions.new(name)
    if data.action_slot is None:
        suitable = next(iter(data.action_suitable_slots), None)
        data.action_slot = suitable or data.action.slots.new(owner.id_type, owner.name)
    return data.action


def ensure_channelbag(owner: bpy.types.Object, name: str) -> bpy.types.ActionChannelbag:
    """Return the bag of F-curves of the object's slot, made where it is missing."""
    return ensure_channelbag_of(owner, ensure_action(owner, name))


def ensure_channelbag_of(owner: bpy.types.Object, action: bpy.types.Action) -> bpy.types.ActionChannelbag:
    """Return the bag of F-curves of the object's slot in an action, which becomes the object's."""
    data = own_animation(owner)
    data.action = action
    if data.action_slot is None:
        ensure_action(owner, action.name)
    layer = action.layers[0] if action.layers else action.layers.new("Layer")
    strip = layer.strips[0] if layer.strips else layer.strips.new(type="KEYFRAME")
    return strip.channelbag(owner.animation_data.action_slot, ensure=True)


def show_action(owner: bpy.types.Object) -> None:
    """Have an object's own action replace what strips of the NLA do, whichever is played alone or edited."""
    data = own_animation(owner)
    data.action_blend_type, data.action_influence = "REPLACE", 1.0
    for track in data.nla_tracks:
        if track.is_solo:
            track.is_solo = False


def find_channelbag(owner: bpy.types.Object) -> bpy.types.ActionChannelbag | None:
    """Return the bag of F-curves of the object's slot, or None where it has no animation."""
    data = owner.animation_data
    return None if data is None else _channelbag_of(data.action, data.action_slot)


def _channelbag_of(
    action: bpy.types.Action | None, slot: bpy.types.ActionSlot | None
) -> bpy.types.ActionChannelbag | None:
    if action is None or slot is None or not action.layers:
        return None
    strips = action.layers[0].strips
    return strips[0].channelbag(slot) if strips else None


def animated_paths(owner: bpy.types.Object) -> set[str]:
    """Return the paths of what an object's animation has curves of: its action, and the strips of the NLA."""
    data = owner.animation_data
    if data is None:
        return set()
    played: list[Any] = [data, *(strip for track in data.nla_tracks for strip in track.strips)]
    bags = [_channelbag_of(each.action, each.action_slot) for each in played]
    return {curve.data_path for bag in bags if bag is not None for curve in bag.fcurves}


def ensure_fcurve(bag: bpy.types.ActionChannelbag, path: str, index: int, group: str) -> bpy.types.FCurve:
    """Return the F-curve of a property's component, made in the named group, if any, where it is missing."""
    curve = bag.fcurves.find(path, index=index)
    if curve is None:
        curve = bag.fcurves.new(path, index=index)
        if group:
            curve.group = bag.groups.get(group) or bag.groups.new(group)
    return curve


def new_keys(frames: ArrayLike, values: ArrayLike, type: str, interpolation: str) -> Keys:
    """Keys at scene frames (K,) with values (K,), of one key type and interpolation."""
    frames = np.asarray(frames)
    keys = np.zeros(len(frames), KEY_TYPE)
    keys["co"] = np.stack([frames, np.asarray(values)], axis=1)
    keys["handle_left"] = keys["co"] - np.array([1 / 3, 0], np.float32)
    keys["handle_right"] = keys["co"] + np.array([1 / 3, 0], np.float32)
    for side in ("handle_left_type", "handle_right_type"):
        keys[side] = enum_value(side, "AUTO_CLAMPED")
    keys["type"], keys["interpolation"] = enum_value("type", type), enum_value("interpolation", interpolation)
    keys["easing"] = enum_value("easing", "AUTO")
    keys["back"], keys["amplitude"], keys["period"] = 1.70158, 0.8, 4.1  # what Blender gives a new key
    return keys


def get_keys(curve: bpy.types.FCurve, fields: np.dtype[np.void] = KEY_TYPE) -> Keys:
    """All keys of an F-curve, with all of their properties or some."""
    points = curve.keyframe_points
    count = len(points)
    keys = np.zeros(count, fields)
    for field, shape, kind in _columns(fields) if count else ():
        column = np.empty((count, *shape), kind)
        points.foreach_get(field, column.ravel())
        keys[field] = column
    return keys


def _columns(fields: np.dtype[np.void]) -> tuple[tuple[str, tuple[int, ...], np.dtype[np.generic]], ...]:
    """Return name, shape and kind of each field."""
    return tuple((name, fields[name].shape, fields[name].base) for name in fields.names or ())


def values_at(curve: bpy.types.FCurve, frames: NDArray[np.int64], keys: Keys | None) -> Array:
    """Return the values (K,) of an F-curve at scene frames: of its keys, where each of these frames has one, which
    takes a fraction of the time. `keys` are the curve's, if they have been read already.
    """
    places = (get_keys(curve, PLACES) if keys is None else keys)["co"]
    if len(places) and not len(curve.modifiers):
        found = np.searchsorted(places[:, 0], frames).clip(max=len(places) - 1)
        if (places[found, 0] == frames).all():
            return places[found, 1].astype(float)
    return np.array([curve.evaluate(float(frame)) for frame in frames])


def joined(groups: Sequence[Keys]) -> Keys:
    """Return keys one group after the other. As bytes: NumPy would look for a type that suits the fields of all."""
    return np.concatenate([_raw(group) for group in groups]).view(KEY_TYPE)[:, 0]


def frames_of(keys: Keys) -> NDArray[np.int64]:
    """Return the scene frames that keys lie on, or nearest to."""
    return np.rint(keys["co"][:, 0]).astype(np.int64)


def are_among(numbers: NDArray[np.int64], frames: ArrayLike) -> NDArray[np.bool_]:
    """Return which of some frame numbers are among others; for so few numbers NumPy's `isin` takes three times as
    long.
    """
    chosen = np.asarray(frames, np.int64).ravel()
    if not len(chosen) or not len(numbers):
        return np.zeros(numbers.shape, bool)
    first, last = int(chosen.min()), int(chosen.max())
    if last - first > _MAX_TABLE_FRAMES:
        return np.isin(numbers, chosen)
    there = np.zeros(last - first + 1, bool)
    there[chosen - first] = True
    places = numbers - first
    inside = (places >= 0) & (places < len(there))
    places[~inside] = 0
    return inside & there[places]


def set_keys(curve: bpy.types.FCurve, groups: Sequence[Keys], *, before: Keys | None = None) -> None:
    """Replace all keys of an F-curve by those of the groups, in the order of their frames.

    Parameters
    ----------
    before : ndarray of KEY_TYPE, shape (K,), optional
        All keys that the curve has. Nothing is written where they are the same.
    """
    filled = [group for group in groups if len(group)] or list(groups[:1])
    keys = joined(filled) if len(filled) > 1 else filled[0]
    at = keys["co"][:, 0]
    if (at[1:] < at[:-1]).any():
        keys = keys[np.argsort(at, kind="stable")]
    points = curve.keyframe_points
    if before is not None and len(before) == len(keys):
        changed = _changed_fields(keys, before)
        if not changed:
            return
    else:
        changed = list(KEY_TYPE.names or ())
        points.clear()
        points.add(len(keys))
    for field in changed:
        points.foreach_set(field, keys[field].ravel())
    curve.update()
    _restore_handles(curve, keys)


def _changed_fields(keys: Keys, before: Keys) -> list[str]:
    """Return the fields in which keys differ from as many others; handles that Blender places do not count."""
    differ = _raw(keys) != _raw(before)
    for side in ("handle_left", "handle_right"):
        placed = _are_placed(keys, side)
        if not placed.all():
            differ[~placed, _BYTES[side]] = False
    return list(dict.fromkeys(_FIELD_OF_BYTE[differ.any(axis=0)].tolist()))


def _raw(keys: Keys) -> NDArray[np.uint8]:
    """Return the bytes of keys, shape (K, B)."""
    return np.ascontiguousarray(keys).view(np.uint8).reshape(len(keys), KEY_TYPE.itemsize)


def _are_placed(keys: Keys, side: str) -> NDArray[np.bool_]:
    """Return which handles of a side lie where a user has placed them, shape (K,)."""
    types = keys[f"{side}_type"]
    return (types == enum_value(f"{side}_type", "FREE")) | (types == enum_value(f"{side}_type", "ALIGNED"))


def _restore_handles(curve: bpy.types.FCurve, keys: Keys) -> None:
    """Restore handles placed by hand exactly, as Blender's update rounds them again."""
    points = curve.keyframe_points
    for side in ("handle_left", "handle_right"):
        placed = _are_placed(keys, side)
        if placed.any():
            updated = np.empty((len(points), 2), np.float32)
            points.foreach_get(side, updated.ravel())
            updated[placed] = keys[side][placed]
            points.foreach_set(side, updated.ravel())
