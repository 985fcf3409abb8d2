"""Bones' turns and skins of rigs that are rendered; needs the bpy module."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import bpy
import numpy as np
from kfmocap.core.numerics.arrays import Array
from mathutils import Matrix
from numpy.typing import NDArray

from .drawing import linear

COLOURS = "colour"
"""Attribute of a mesh with the colours of its vertices, linear light."""


def any_direction(rng: np.random.Generator) -> Array:
    """Return a unit vector in a random direction, shape (3,)."""
    way = rng.normal(size=3)
    return np.asarray(way / np.linalg.norm(way))


def key_turn(bone: bpy.types.PoseBone, turn: Matrix, frame: int) -> None:
    """Turn a bone from its rest pose, near to how it is turned, and key it in its rotation mode."""
    if bone.rotation_mode == "QUATERNION":
        turned = turn.to_quaternion()
        turned.make_compatible(bone.rotation_quaternion)
        bone.rotation_quaternion = turned
        bone.keyframe_insert("rotation_quaternion", frame=frame)
    else:
        bone.rotation_euler = turn.to_euler(bone.rotation_mode, bone.rotation_euler)
        bone.keyframe_insert("rotation_euler", frame=frame)


def coloured_mesh(name: str, vertices: Array, triangles: NDArray[np.int64], colours: Array) -> bpy.types.Object:
    """Add a mesh with colours of its vertices, sRGB, 0..1, shape (V, 3), to the scene."""
    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata(vertices.tolist(), [], triangles.tolist())
    attribute = mesh.color_attributes.new(COLOURS, "FLOAT_COLOR", "POINT")
    rgba = np.concatenate([linear(colours), np.ones((len(vertices), 1))], axis=1)
    attribute.data.foreach_set("color", rgba.astype(np.float32).ravel())
    owner = bpy.data.objects.new(name, mesh)
    bpy.context.scene.collection.objects.link(owner)
    return owner


def colours_of(mesh: bpy.types.Mesh) -> Array:
    """Return the colours of a mesh's vertices, see `coloured_mesh`: red, green, blue, linear light, shape (V, 3)."""
    rgba = np.empty(4 * len(mesh.vertices), np.float32)
    mesh.color_attributes[COLOURS].data.foreach_get("color", rgba)
    return rgba.reshape(-1, 4)[:, :3].astype(float)


def bind(skin: bpy.types.Object, armature: bpy.types.Object, weights: Mapping[str, Array]) -> None:
    """Bind a mesh to an armature with the weights (V,) of each bone."""
    skin.parent = armature
    for bone, values in weights.items():
        group = skin.vertex_groups.new(name=bone)
        for vertex in np.flatnonzero(values > 0).tolist():
            group.add([vertex], float(values[vertex]), "REPLACE")
    skin.modifiers.new("Armature", "ARMATURE").object = armature


def new_armature(name: str, matrix: Array, bones: Sequence[tuple[str, str, Array, Array]]) -> bpy.types.Object:
    """Add an armature to the scene.

    Parameters
    ----------
    matrix : ndarray, shape (4, 4)
        Of the object.
    bones : sequence of (str, str, ndarray, ndarray)
        Name, parent (empty for none), head and tail in the world, metres.
    """
    armature = bpy.data.objects.new(name, bpy.data.armatures.new(name))
    bpy.context.scene.collection.objects.link(armature)
    armature.matrix_world = Matrix(matrix.tolist())
    to_local = np.linalg.inv(matrix)
    bpy.context.view_layer.objects.active = armature
    bpy.ops.object.mode_set(mode="EDIT")
    for bone, parent, *ends in bones:
        edited = armature.data.edit_bones.new(bone)
        edited.head, edited.tail = ((to_local[:3, :3] @ end + to_local[:3, 3]).tolist() for end in ends)
        edited.parent = armature.data.edit_bones[parent] if parent else None
    bpy.ops.object.mode_set(mode="OBJECT")
    return armature
