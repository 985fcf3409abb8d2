"""Library overrides of linked characters, which are needed to animate them."""

from __future__ import annotations

from typing import Any

import bpy
from mathutils import Matrix

from ....core.errors import BodyError


def editable(armature: bpy.types.Object, scene: bpy.types.Scene) -> bpy.types.Object:
    """Return an armature that can be animated in this file: itself, or the override of a linked one.

    Raises
    ------
    BodyError
        Blender cannot make an override of it.
    """
    if armature.library is None:
        return armature
    there = _override_of(armature)
    if there is not None:
        return there
    layer = scene.view_layers[0]
    collection = _linked_collection(armature)
    if collection is not None:
        instance: Any = _instance_of(collection, scene)
        made_of: Any = collection.override_hierarchy_create(scene, layer, reference=instance, do_fully_editable=True)
        if instance is not None and made_of is not None:
            _take_place(instance, made_of)
    else:
        armature.override_hierarchy_create(scene, layer, do_fully_editable=True)
    made = _override_of(armature)
    if made is None:
        raise BodyError(
            "it is linked, and Blender makes no override of it",
            where=f"armature {armature.name}",
            todo="make a library override of the character, or append it",
        )
    return made


def _instance_of(collection: bpy.types.Collection, scene: bpy.types.Scene) -> bpy.types.Object | None:
    """Return the object that shows an instance of a collection: the active one, if it does."""
    active = scene.view_layers[0].objects.active
    candidates = [active, *scene.objects] if active is not None else list(scene.objects)
    return next((o for o in candidates if o.instance_collection == collection and o.instance_type != "NONE"), None)


def _take_place(instance: bpy.types.Object, made: bpy.types.Collection) -> None:
    """Put the objects of an override where an instance has shown them, and follow it; it shows them no longer."""
    for thing in made.all_objects:
        if thing.parent is None:
            thing.parent = instance
            thing.matrix_parent_inverse = Matrix.Translation(-made.instance_offset)
    instance.instance_type = "NONE"


def _override_of(armature: bpy.types.Object) -> bpy.types.Object | None:
    found = (o for o in bpy.data.objects if o.override_library and o.override_library.reference == armature)
    return next(found, None)


def _linked_collection(armature: bpy.types.Object) -> bpy.types.Collection | None:
    """Return the linked collection that holds an armature and is itself instanced or in the scene."""
    found = [c for c in bpy.data.collections if c.library is not None and armature.name in c.all_objects]
    return max(found, key=lambda c: len(c.all_objects), default=None)
