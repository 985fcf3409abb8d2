"""Constraints and drivers that hold the controls of a rig: taken away while the controls are posed, and given back."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any

import bpy

from ...scene_io import fcurves
from ...scene_io.body.body_armature import edit_bones
from ...scene_io.constraints import acts
from ...scene_io.linked import linked_file
from .rig_at_rest import update

_HOLDS = (
    "IK",
    "COPY_ROTATION",
    "COPY_TRANSFORMS",
    "DAMPED_TRACK",
    "LOCKED_TRACK",
    "TRACK_TO",
    "STRETCH_TO",
    "SPLINE_IK",
    "TRANSFORM",
    "LIMIT_ROTATION",
    "LIMIT_LOCATION",
    "LIMIT_DISTANCE",
    "FLOOR",
    "SHRINKWRAP",
    "PIVOT",
)
"""Kinds of constraints that set or limit the rotation of the bones that they act on, limit their movement, or displace
them."""
_PLACES = ("COPY_LOCATION", "FOLLOW_PATH", "CLAMP_TO")
"""Kinds of constraints that set where bones are: they hold those that are to move through the world, and may carry the
others."""
_CHAINS = ("IK", "SPLINE_IK")
Constraint = tuple[str, str]
"""A constraint: its bone and its name."""
Driver = tuple[str, str]
"""A driver of a bone's rotation or place: the bone and the attribute."""


@contextmanager
def without_holds(
    armature: bpy.types.Object, controls: Sequence[str], moved: Collection[str]
) -> Iterator[dict[tuple[str, str], float]]:
    """Switch off the constraints that override the rotation of controls (influence 0); after an error they act again.

    Yields the influence that they had, by bone and constraint. Inverse kinematics belongs to the bone that ends its
    chain, which may be below the controls. Of controls in `moved`, which move through the world, constraints of their
    position are switched off, too.
    """
    before = {}
    for bone in armature.pose.bones:
        for constraint in list[Any](bone.constraints):
            poses = [bone.name]
            if constraint.type in _CHAINS:
                chain = [bone, *bone.parent_recursive]
                poses = [one.name for one in chain[: constraint.chain_count or len(chain)]]
            kinds = _HOLDS + _PLACES if bone.name in moved else _HOLDS
            holds = constraint.type in kinds and acts(constraint)
            if holds and set(poses) & set(controls):
                before[bone.name, constraint.name] = constraint.influence
                constraint.influence = 0.0
    update()
    try:
        yield before
    except BaseException:
        restore_holds(armature, before)
        raise


@contextmanager
def without_drivers(
    armature: bpy.types.Object, controls: Sequence[str], moved: Collection[str]
) -> Iterator[tuple[Driver, ...]]:
    """Mute the drivers of the rotations of controls, and of the positions of those in `moved`, because keys have no
    effect beside them; after an error they act again. Yields those that acted. Library overrides keep the muting.
    """
    found: dict[Driver, None] = {}
    for curve in _drivers(armature):
        bone, attribute = driven = _driven(curve)
        if not curve.mute and ((_turns(attribute) and bone in controls) or (attribute == "location" and bone in moved)):
            found[driven] = None
    _mute(armature, found, mute=True)
    try:
        yield tuple(found)
    except BaseException:
        restore_drivers(armature, tuple(found))
        raise


def turned_by_driver(armature: bpy.types.Object, name: str) -> bool:
    """Return whether a driver acts on the rotation of a bone."""
    acting = [_driven(curve) for curve in _drivers(armature) if not curve.mute]
    return any(bone == name and _turns(attribute) for bone, attribute in acting)


@contextmanager
def with_drivers(armature: bpy.types.Object, muted: Collection[Driver]) -> Iterator[None]:
    """Have muted drivers act while the block runs."""
    restore_drivers(armature, muted)
    try:
        yield
    finally:
        _mute(armature, muted, mute=True)


def restore_drivers(armature: bpy.types.Object, muted: Collection[Driver]) -> None:
    """Have drivers act again, where they are still there."""
    _mute(armature, muted, mute=False)


def _mute(armature: bpy.types.Object, drivers: Collection[Driver], *, mute: bool) -> None:
    paths = {fcurves.bone_path(*driver) for driver in drivers}
    for curve in _drivers(armature):
        if curve.data_path in paths:
            curve.mute = mute
    if paths:
        armature.update_tag()
        update()


def _drivers(armature: bpy.types.Object) -> Sequence[Any]:
    return list(armature.animation_data.drivers) if armature.animation_data else []


def _driven(curve: Any) -> Driver:
    return fcurves.bone_of(curve.data_path), curve.data_path.rpartition(".")[2]


def _turns(attribute: str) -> bool:
    return attribute.startswith("rotation_") and attribute != "rotation_mode"


@contextmanager
def without_connections(armature: bpy.types.Object, moved: Collection[str]) -> Iterator[dict[str, bool]]:
    """Disconnect bones that are moved through the world from their parents, as a connected bone cannot move; after an
    error they are connected again. Yields those that were connected, and whether they still are, as in a linked
    armature.
    """
    connected = [name for name in moved if armature.data.bones[name].use_connect]
    linked = bool(linked_file(armature.data))
    connect(armature, [] if linked else connected, to_parent=False)
    try:
        yield dict.fromkeys(connected, linked)
    except BaseException:
        connect(armature, [] if linked else connected, to_parent=True)
        raise


def connect(armature: bpy.types.Object, names: Collection[str], *, to_parent: bool) -> None:
    """Connect bones to those above, or disconnect them."""
    if names:
        with edit_bones(armature) as bones:
            for name in names:
                bones[name].use_connect = to_parent


@contextmanager
def without_limits(armature: bpy.types.Object) -> Iterator[None]:
    """Mute the limits of rotations while the block runs."""
    limits = [
        (bone.name, limit.name)
        for bone in armature.pose.bones
        for limit in bone.constraints
        if limit.type == "LIMIT_ROTATION" and not limit.mute
    ]
    mute_constraints(armature, limits, muted=True)
    try:
        yield
    finally:
        mute_constraints(armature, limits, muted=False)


def mute_constraints(armature: bpy.types.Object, which: Collection[Constraint], *, muted: bool) -> None:
    """Mute constraints, or have them act again."""
    for bone, name in which:
        held: Any = armature.pose.bones[bone].constraints[name]
        held.mute = muted
    if which:
        armature.update_tag()
        update()


def restore_holds(armature: bpy.types.Object, before: Mapping[tuple[str, str], float]) -> None:
    """Give constraints the influence that they had, by bone and constraint, where they are still there."""
    for (name, held_by), influence in before.items():
        bone: Any = armature.pose.bones.get(name)
        constraint = None if bone is None else bone.constraints.get(held_by)
        if constraint is not None:
            constraint.influence = influence
