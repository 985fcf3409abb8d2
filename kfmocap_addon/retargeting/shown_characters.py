"""Characters that a scene does not show: they are brought into it."""

from __future__ import annotations

import bpy

from ..scene_io.characters.skins import deformed_objects


def show_in(scene: bpy.types.Scene, armature: bpy.types.Object) -> bool:
    """Bring an armature, and what hangs on it, into a scene, if it is in another one only; return whether it was.

    A shot is loaded into a scene of its own, and a character that was opened before would move where nobody looks.
    """
    if armature.name in scene.objects:
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


def _hanging_on(armature: bpy.types.Object) -> list[bpy.types.Object]:
    """Return an armature's children, and the objects that it deforms."""
    children = armature.children_recursive
    return [*children, *(o for o in deformed_objects(armature) if o not in children)]
