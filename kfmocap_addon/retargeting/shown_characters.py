"""Characters that a scene does not show: they are brought into it."""

from __future__ import annotations

import bpy

from ..scene_io.characters.skins import deformed_objects


def show_in(scene: bpy.types.Scene, armature: bpy.types.Object) -> bool:
    """Bring an armature, and what hangs on it, into a scene that shows neither it nor an instance of it; return whether
    that was so.

    A shot is loaded into a scene of its own, and a character that was opened before would move where nobody looks.
    """
    if shows(scene, armature):
        return False
    members = [armature, *_hanging_on(armature)]
    for collection in sorted(bpy.data.collections, key=lambda c: len(c.all_objects)):
        if set(members) <= set(collection.all_objects):
            scene.collection.children.link(collection)
            return True
    for member in members:
        if member.name not in scene.objects:
            scene.collection.objects.link(member)
    return True


def shows(scene: bpy.types.Scene, armature: bpy.types.Object) -> bool:
    """Whether an armature is in a scene, or an object of it shows an instance of a collection with it."""
    if armature.name in scene.objects:
        return True
    waiting = [o.instance_collection for o in scene.objects if o.instance_type == "COLLECTION"]
    seen: set[bpy.types.Collection] = set()
    while waiting:
        collection = waiting.pop()
        if collection is None or collection in seen:
            continue
        seen.add(collection)
        if armature.name in collection.all_objects:
            return True
        waiting += [o.instance_collection for o in collection.all_objects if o.instance_type == "COLLECTION"]
    return False


def _hanging_on(armature: bpy.types.Object) -> list[bpy.types.Object]:
    """Return an armature's children, and the objects that it deforms."""
    children = armature.children_recursive
    return [*children, *(o for o in deformed_objects(armature) if o not in children)]
