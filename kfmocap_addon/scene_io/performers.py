"""Adding performers to a scene: a new body, or an existing armature."""

from __future__ import annotations

from collections.abc import Sequence

import bpy

from ...core.body import Body
from ...core.errors import BodyError
from . import scene
from .body import body_armature, part_meshes, rotation_modes, shown_model


def add_performer(current: bpy.types.Scene, body: Body, name: str, place: Sequence[float]) -> bpy.types.Object:
    """Build a body's armature, which stands at a place in the world, and make it a performer of the scene's shot."""
    armature = body_armature.build_armature(
        body, scene.free_name(name, current.kfmocap.performers), scene.ensure_collection(current, "Performers")
    )
    armature.location = place
    return take_armature(current, armature)


def restore(current: bpy.types.Scene, slot: bpy.types.PropertyGroup) -> None:
    """Bring a performer's armature and its parts back into the scene that they were deleted from."""
    home = scene.ensure_collection(current, "Performers")
    for owner in (slot.armature, *part_meshes.parts_of(slot.armature)):
        if owner.name not in current.objects:
            home.objects.link(owner)
    shown_model.show_model(current)


def remove(current: bpy.types.Scene, number: int) -> None:
    """Remove a performer from the shot and, if its armature was deleted, the parts that were left behind.

    An armature of another scene, such as that of which this one is a copy, was not deleted.
    """
    slots = current.kfmocap.performers
    armature = slots[number].armature
    is_gone = armature is None or not armature.users_scene
    slots.remove(number)
    left = part_meshes.orphans(current) if armature is None else part_meshes.parts_of(armature)
    for part in left if is_gone else ():
        mesh = part.data
        bpy.data.objects.remove(part)
        if mesh.users == 0:
            bpy.data.meshes.remove(mesh)
    if is_gone and armature is not None and armature.users == 0:
        bpy.data.objects.remove(armature)


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
    rotation_modes.to_quaternions(armature, [bone.name for bone in body_armature.body_bones(armature)])
    scene.add_slot(current, scene.free_name(armature.name, current.kfmocap.performers), armature)
    if not current.kfmocap.shot:
        current.kfmocap.shot = "shot"
    shown_model.show_model(current)
    return armature
