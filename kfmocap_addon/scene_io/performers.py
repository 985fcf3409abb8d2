"""Performers added to a scene one by one: a new body, or an armature that is there."""

from __future__ import annotations

from collections.abc import Sequence

import bpy

from ...core.body import Body
from ...core.errors import BodyError
from . import body_armature, part_meshes, scene


def add_performer(
    current: bpy.types.Scene, body: Body, name: str, place: Sequence[float] = (0, 0, 0)
) -> bpy.types.Object:
    """Build a body's armature, which stands at a place in the world, and make it a performer of the scene's shot."""
    armature = body_armature.build_armature(
        body, scene.free_name(name, current.kfmocap.performers), scene.ensure_collection(current, "Performers")
    )
    armature.location = place
    return take_armature(current, armature)


def take_armature(current: bpy.types.Scene, armature: bpy.types.Object) -> bpy.types.Object:
    """Make an armature whose bones carry meshes a performer of the scene's shot.

    Raises
    ------
    BodyError
        It cannot be a body, or is a performer already.
    """
    if any(slot.armature == armature for slot in current.kfmocap.performers):
        raise BodyError("it is a performer already", where=f"armature {armature.name}")
    body_armature.body_from_armature(armature)
    for bone in body_armature.body_bones(armature):
        armature.pose.bones[bone.name].rotation_mode = "QUATERNION"
    slot = current.kfmocap.performers.add()
    slot.name, slot.armature = scene.free_name(armature.name, current.kfmocap.performers), armature
    if not current.kfmocap.shot:
        current.kfmocap.shot = "shot"
    part_meshes.show_parts(current)
    return armature
