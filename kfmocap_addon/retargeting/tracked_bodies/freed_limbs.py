"""Limbs that inverse kinematics move by their own bones: they are freed, so that these bones can be posed."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from contextlib import contextmanager
from typing import Any

import bpy

from ....core.retargeting.bone_matching import preset_of
from ....core.retargeting.bone_roles.roles import SIDES
from ...scene_io import fcurves
from ...scene_io.characters.followed_bones import following
from ...scene_io.constraints import acts
from ..rigs.held_bones import Constraint, mute_constraints
from .part_roles import limb_bones

_LIMBS = (("upper_arm", "forearm", "hand"), ("thigh", "shin", "foot"))
_TRUNK = ("hips", "spine", "neck", "head")
_TURNING = ("IK", "COPY_ROTATION", "COPY_TRANSFORMS", "DAMPED_TRACK", "LOCKED_TRACK", "TRACK_TO", "STRETCH_TO")
"""Kinds of constraints that turn the bones of a limb with inverse kinematics, its hand or foot included."""


@contextmanager
def without_goals(armature: bpy.types.Object) -> Iterator[tuple[Constraint, ...]]:
    """Mute the constraints that move limbs by inverse kinematics on their own bones; after an error they act again.
    Yields those that acted.

    Limbs that a driver switches between inverse and forward kinematics, and rigs whose bones follow controls, are dealt
    with elsewhere (`rigs.rig_settings`, `characters.followed_bones`).
    """
    found = tuple(_goals(armature))
    mute_constraints(armature, found, muted=True)
    try:
        yield found
    except BaseException:
        mute_constraints(armature, found, muted=False)
        raise


@contextmanager
def with_goals(armature: bpy.types.Object, goals: Collection[Constraint]) -> Iterator[None]:
    """Have muted constraints act while the block runs."""
    mute_constraints(armature, goals, muted=False)
    try:
        yield
    finally:
        mute_constraints(armature, goals, muted=True)


def freed_remarks(goals: Collection[Constraint]) -> list[str]:
    """Return what to report of limbs that have been freed."""
    return [
        f"bone {bone}: its constraint '{name}' is muted now: the limb is turned by its own bones"
        for bone, name in goals
    ]


def _goals(armature: bpy.types.Object) -> Iterator[Constraint]:
    bones = limb_bones(armature)
    trunk = {name for role, names in bones.bones.items() if role in _TRUNK for name in names}
    if preset_of(bones).settings or trunk & set(following(armature)):
        return
    driven = _driven_constraints(armature)
    for limb in _LIMBS:
        for side in SIDES:
            found = _goals_of(
                armature, [bones.bones[f"{role}.{side}"][0] for role in limb if f"{role}.{side}" in bones.bones]
            )
            if not set(found) & driven:
                yield from found


def _goals_of(armature: bpy.types.Object, limb: list[str]) -> list[Constraint]:
    """Return the constraints that turn a limb, given its bones from above, if inverse kinematics do."""
    found, solved = [], False
    for bone in armature.pose.bones:
        for held in list[Any](bone.constraints):
            if held.type not in _TURNING or not acts(held):
                continue
            chain = [bone.name]
            if held.type == "IK":
                chain = [each.name for each in [bone, *bone.parent_recursive][: held.chain_count or None]]
                solved |= bool(set(chain) & set(limb[:2]))
            if set(chain) & set(limb):
                found.append((bone.name, held.name))
    return found if solved else []


def _driven_constraints(armature: bpy.types.Object) -> set[Constraint]:
    data = armature.animation_data
    paths = [driver.data_path for driver in data.drivers] if data else []
    return {(fcurves.bone_of(path), fcurves.constraint_of(path)) for path in paths if fcurves.constraint_of(path)}
