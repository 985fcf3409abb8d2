"""Whether a 3D view shows an object, whatever hides it, and showing it again."""

from __future__ import annotations

from collections.abc import Iterator

import bpy


def is_hidden(context: bpy.types.Context, thing: bpy.types.Object) -> bool:
    """Whether an object of the scene is hidden in the 3D view of the context, if it has one: itself, with its
    collection, with all objects of its type, or because the view shows others alone.
    """
    layer = context.view_layer
    if thing.name not in context.scene.objects:
        return False
    return thing.name not in layer.objects or not thing.visible_get(view_layer=layer, viewport=_space(context))


def show(context: bpy.types.Context, thing: bpy.types.Object) -> None:
    """Show an object of the scene in the view layer and the 3D view of the context."""
    layer, space = context.view_layer, _space(context)
    for branch in _branches(layer.layer_collection, thing):
        for item in branch:
            item.exclude = item.hide_viewport = item.collection.hide_viewport = False
    thing.hide_viewport = False
    thing.hide_set(False, view_layer=layer)
    if space is not None:
        setattr(space, f"show_object_viewport_{thing.type.lower()}", True)
        if space.local_view is not None:
            thing.local_view_set(space, True)


def _space(context: bpy.types.Context) -> bpy.types.SpaceView3D | None:
    space = context.space_data
    return space if isinstance(space, bpy.types.SpaceView3D) else None


def _branches(
    item: bpy.types.LayerCollection, thing: bpy.types.Object
) -> Iterator[tuple[bpy.types.LayerCollection, ...]]:
    """Yield the way to each layer collection that has the object, without the scene's own, which cannot be hidden."""
    if thing.name in item.collection.objects:
        yield ()
    for child in item.children:
        for branch in _branches(child, thing):
            yield (child, *branch)
