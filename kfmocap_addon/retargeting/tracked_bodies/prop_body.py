"""Using a mesh object, such as a prop, as a body of one part."""

from __future__ import annotations

from typing import Any

import bpy
from mathutils import Matrix

from ....core.errors import BodyError
from ...scene_io import fcurves
from ...scene_io.body import body_armature
from ...scene_io.constraints import acts
from ...scene_io.keys import key_pose_curves
from ...scene_io.visited_frames import same_time
from .skinned_body import use_as_body

_MIN_VERTICES = 8
_CONSTANT_MODIFIERS = (
    "SUBSURF",
    "BEVEL",
    "MIRROR",
    "SOLIDIFY",
    "TRIANGULATE",
    "WEIGHTED_NORMAL",
    "EDGE_SPLIT",
    "ARRAY",
    "DECIMATE",
)
"""Kinds of modifiers that do not change over time."""


def use_as_prop(current: bpy.types.Scene, mesh: bpy.types.Object) -> bpy.types.Object:
    """Make a mesh object a performer of one part; returns its new armature, whose bone moves it from now on.

    Keys that the object has become keys of the bone on the same frames. Objects that hang on it hang on the bone.

    Raises
    ------
    BodyError
        Something else than its own location and rotation moves it, or it is flat.
    """
    _refuse_moved(mesh)
    if min(*mesh.dimensions) <= 0 or len(mesh.data.vertices) < _MIN_VERTICES:
        todo = f"give it at least {_MIN_VERTICES} vertices that enclose a volume"
        raise BodyError("the mesh is flat, or has too few vertices", where=f"mesh {mesh.name}", todo=todo)
    keyed = _keyed_places(current, mesh)
    world = mesh.matrix_world.copy()
    armature, name = _armature_at(mesh)
    current.collection.objects.link(armature)
    before = mesh.parent, mesh.matrix_parent_inverse.copy()
    mesh.parent, mesh.matrix_parent_inverse = armature, Matrix.Identity(4)
    mesh.matrix_basis = world
    group = mesh.vertex_groups.new(name=name)
    group.add(range(len(mesh.data.vertices)), 1.0, "REPLACE")
    modifier: Any = mesh.modifiers.new("Armature", "ARMATURE")
    modifier.object = armature
    hung = _hung_on_bone(mesh, armature, name, world)
    current.view_layers[0].update()
    try:
        use_as_body(current, armature)
    except BodyError:
        mesh.modifiers.remove(modifier)
        mesh.vertex_groups.remove(group)
        mesh.parent, mesh.matrix_parent_inverse = before
        mesh.matrix_world = world
        for child, inverse in hung.items():
            child.parent, child.parent_type, child.matrix_parent_inverse = mesh, "OBJECT", inverse
        data = armature.data
        bpy.data.objects.remove(armature)
        bpy.data.armatures.remove(data)
        raise
    if keyed:
        mesh.animation_data_clear()
        mesh.matrix_basis = world
    posed = armature.pose.bones[name]
    for frame, matrix in keyed.items():
        posed.matrix = matrix
        key_pose_curves.key_current_pose(armature, frame)
    current.frame_set(current.frame_current, subframe=current.frame_subframe)
    return armature


def _hung_on_bone(
    mesh: bpy.types.Object, armature: bpy.types.Object, name: str, world: Matrix
) -> dict[bpy.types.Object, Matrix]:
    """Parent the children of a mesh, which was at a place in the world, to a bone that stands for it, each with its own
    channels as they are; returns the inverse matrices of parents that they had.
    """
    bone = armature.data.bones[name]
    to_tail = (bone.matrix_local @ Matrix.Translation((0.0, bone.length, 0.0))).inverted()
    hung = {child: child.matrix_parent_inverse.copy() for child in mesh.children if child.parent_type == "OBJECT"}
    for child, inverse in hung.items():
        child.parent, child.parent_type, child.parent_bone = armature, "BONE", name
        child.matrix_parent_inverse = to_tail @ world @ inverse
    return hung


def _armature_at(mesh: bpy.types.Object) -> tuple[bpy.types.Object, str]:
    """Return a new armature with one bone where a mesh object is, as it is turned, and the bone's name."""
    place, turn, _ = mesh.matrix_world.decompose()
    armature = bpy.data.objects.new(f"{mesh.name} rig", bpy.data.armatures.new(f"{mesh.name} rig"))
    with body_armature.edit_bones(armature) as bones:
        bone = bones.new(mesh.name)
        bone.tail = (0.0, max(*mesh.dimensions, 1e-3), 0.0)
        bone.matrix = Matrix.LocRotScale(place, turn, None)
        return armature, bone.name


def _refuse_moved(mesh: bpy.types.Object) -> None:
    """Raise a BodyError if anything but its own channels moves a mesh, or if its shape changes."""
    holds = next((c for c in mesh.constraints if acts(c)), None)
    shaped = next((m for m in mesh.modifiers if m.show_viewport and m.type not in _CONSTANT_MODIFIERS), None)
    what = ""
    if holds is not None:
        what = f"it is moved by its constraint '{holds.name}'"
    elif shaped is not None:
        what = f"its shape is changed by the modifier '{shaped.name}'"
    elif mesh.rigid_body is not None and mesh.rigid_body.type == "ACTIVE" and not mesh.rigid_body.kinematic:
        what = "it is moved by rigid body physics"
    elif mesh.parent is not None:
        what = f"it is moved by its parent '{mesh.parent.name}'"
    elif mesh.animation_data is not None and mesh.animation_data.drivers:
        what = "it is moved by a driver"
    if what:
        todo = "remove that, so that its own location and rotation are all that moves it"
        raise BodyError(what, where=f"mesh {mesh.name}", todo=todo)


def _keyed_places(current: bpy.types.Scene, mesh: bpy.types.Object) -> dict[int, Matrix]:
    """Location and rotation of an object on the frames on which it has keys."""
    bag = fcurves.find_channelbag(mesh)
    curves = [fcurves.get_keys(curve) for curve in bag.fcurves] if bag else []
    frames = sorted({int(frame) for keys in curves for frame in fcurves.frames_of(keys)})
    if not frames:
        return {}
    found = {}
    with same_time(current):
        for frame in frames:
            current.frame_set(frame)
            place, turn, _ = mesh.matrix_world.decompose()
            found[frame] = Matrix.LocRotScale(place, turn, None)
    return found
