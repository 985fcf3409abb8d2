"""Custom properties that switch a rig, such as from IK to FK: of bones, of the armature, or of other objects."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any

import bpy
import numpy as np

from ...scene_io import fcurves
from .rig_at_rest import update
from .rig_curves import ControlChannel

Owner = str | tuple[str, str]
"""What has a property: a bone, by its name, or a data-block, by its kind (see `_KINDS`) and name."""
Settings = Mapping[Owner, Mapping[str, float]]
_KINDS = {"OBJECT": "objects", "ARMATURE": "armatures", "SCENE": "scenes"}
_HUGE = 1e3
"""Limits of a property's range beyond which it counts as unlimited."""
_SWITCHES = 24
"""Largest number of custom properties that are tried, those that drive most constraints first."""


@contextmanager
def with_settings(
    armature: bpy.types.Object, settings: Mapping[Any, Mapping[str, float]]
) -> Iterator[dict[tuple[Owner, str], Any]]:
    """Set custom properties, where there are such; after an error they are what they were.

    Gives what they were, by owner and property.
    """
    before = set_settings(armature, settings)
    try:
        yield before
    except BaseException:
        restore_settings(armature, before)
        raise


@contextmanager
def trying_settings(armature: bpy.types.Object, settings: Mapping[Any, Mapping[str, float]]) -> Iterator[None]:
    """Set custom properties, where there are such, while the block runs."""
    before = set_settings(armature, settings)
    try:
        yield
    finally:
        restore_settings(armature, before)
        update()


def set_settings(
    armature: bpy.types.Object, settings: Mapping[Any, Mapping[str, float]]
) -> dict[tuple[Owner, str], Any]:
    """Set custom properties, where there are such; returns what they were, by owner and property."""
    before: dict[tuple[Owner, str], Any] = {}
    for name, values in settings.items():
        owner = owner_of(armature, name)
        for key, value in values.items() if owner is not None else ():
            if key in owner:
                before[name, key] = owner[key]
                owner[key] = type(owner[key])(value)
                owner.id_data.update_tag()
    armature.update_tag()
    update()
    return before


def restore_settings(armature: bpy.types.Object, before: Mapping[tuple[Owner, str], Any]) -> None:
    """Set custom properties to what they were, by owner and property."""
    for (name, key), value in before.items():
        owner = owner_of(armature, name)
        if owner is not None:
            owner[key] = value
            owner.id_data.update_tag()
    armature.update_tag()


def owner_of(armature: bpy.types.Object, name: Owner) -> Any:
    """Return the bone or the data-block that has a property, None where it is no longer there."""
    if isinstance(name, str):
        return armature.pose.bones.get(name)
    kind, block = name
    return getattr(bpy.data, _KINDS[kind]).get((block, None))


def setting_name(name: Owner) -> str:
    """Return what has a property in words."""
    return f"bone {name}" if isinstance(name, str) else f"{name[0].lower()} {name[1]}"


def setting_channels(armature: bpy.types.Object, settings: Iterable[tuple[Owner, str]]) -> list[ControlChannel]:
    """Return channels with the present values of settings, so that the action of the armature object includes them;
    none for those that another data-block has.
    """
    channels = []
    for name, key in settings:
        owner = owner_of(armature, name)
        if owner.id_data == armature:
            bone = name if isinstance(name, str) else ""
            channels.append(ControlChannel(bone, fcurves.property_key(key), np.array([[float(owner[key])]])))
    return channels


def keep_in_override(armature: bpy.types.Object, settings: Settings, frame: int) -> None:
    """Key settings on a frame of an armature that overrides a linked one, as values of properties that are not made
    overridable are lost when the file is saved.
    """
    if armature.override_library is None:
        return
    for channel in setting_channels(armature, [(name, key) for name, values in settings.items() for key in values]):
        bag = fcurves.ensure_channelbag(armature, armature.name)
        curve = fcurves.ensure_fcurve(bag, channel.path, 0, channel.bone)
        fcurves.set_keys(curve, [fcurves.new_keys([frame], channel.values[:, 0], "KEYFRAME", "CONSTANT")])


def setting_curves(armature: bpy.types.Object, name: Owner, key: str) -> list[bpy.types.FCurve]:
    """Return the curves with keys of a property."""
    bag = fcurves.find_channelbag(owner_of(armature, name).id_data)
    path = fcurves.bone_path(name, fcurves.property_key(key)) if isinstance(name, str) else fcurves.property_key(key)
    return [] if bag is None else [curve for curve in bag.fcurves if curve.data_path == path]


def has_keys(armature: bpy.types.Object, name: Owner, key: str) -> bool:
    """Whether a property has keys."""
    return bool(setting_curves(armature, name, key))


def property_ends(owner: Any, key: str) -> tuple[float, float]:
    """Return the ends of a custom property's range; 0 and 1 where it has none."""
    if isinstance(owner[key], bool):
        return 0.0, 1.0
    shown = owner.id_properties_ui(key).as_dict()
    ends = float(shown.get("soft_min", 0.0)), float(shown.get("soft_max", 1.0))
    return ends if max(map(abs, ends)) < _HUGE else (0.0, 1.0)


def switches(armature: bpy.types.Object) -> dict[tuple[Owner, str], list[str]]:
    """Return the custom properties that drive constraints, and the bones whose they drive; those of most bones first.

    A property that is driven itself stands for those that drive it.
    """
    found: dict[tuple[Owner, str], list[str]] = {}
    for curve in _drivers(armature):
        if ".constraints[" in curve.data_path:
            for source in _sources(curve.driver, armature, ()):
                found.setdefault(source, []).append(fcurves.bone_of(curve.data_path))
    return dict(sorted(found.items(), key=lambda item: -len(item[1]))[:_SWITCHES])


def switched_bones(armature: bpy.types.Object) -> set[str]:
    """Return the bones on which constraints act whose influence is driven, chains of inverse kinematics included."""
    found = set()
    for curve in _drivers(armature):
        bone: Any = armature.pose.bones.get(fcurves.bone_of(curve.data_path))
        name = fcurves.constraint_of(curve.data_path)
        held: Any = bone.constraints.get(name) if bone is not None else None
        if held is not None:
            length = (held.chain_count or None) if held.type == "IK" else 1
            found |= {each.name for each in [bone, *bone.parent_recursive][:length]}
    return found


def _drivers(block: Any) -> Sequence[Any]:
    data = getattr(block, "animation_data", None)
    return list(data.drivers) if data else []


def _sources(driver: Any, armature: bpy.types.Object, seen: tuple[str, ...]) -> Iterator[tuple[Owner, str]]:
    """Generate the custom properties that a driver reads, in the end."""
    for target in (target for variable in driver.variables for target in variable.targets):
        block, path = target.id, target.data_path
        if block is None or block.library is not None or path in seen:
            continue
        above = next((curve for curve in _drivers(block) if curve.data_path == path), None)
        if above is not None:
            yield from _sources(above.driver, armature, (*seen, path))
            continue
        bone, key = fcurves.custom_property_of(path)
        name: Owner = bone or (block.id_type, block.name)
        reachable = key and (block == armature if bone else block.id_type in _KINDS)
        owner = owner_of(armature, name) if reachable else None
        if owner is not None and isinstance(owner.get(key), (int, float)):
            yield name, key
