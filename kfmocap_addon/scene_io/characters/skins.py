"""Skins of characters: the meshes that an armature moves, and which bone leads each of their vertices."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import bpy
import numpy as np
from numpy.typing import NDArray

from ....core.numerics.arrays import Array
from .followed_bones import skeletons_following

_LEADING_SHARE = 0.5
"""Share of a vertex's weight from which on a bone leads it."""
_MOVING = (
    *("DATA_TRANSFER", "NODES", "VERTEX_WEIGHT_EDIT", "VERTEX_WEIGHT_MIX", "VERTEX_WEIGHT_PROXIMITY"),
    *("CLOTH", "CURVE", "HOOK", "LATTICE", "MESH_DEFORM", "SHRINKWRAP", "SOFT_BODY", "SURFACE_DEFORM"),
)
"""Modifiers that may give weights, or move vertices that have none."""


@dataclass(frozen=True, eq=False)
class Skin:
    """The skin of a character at rest: vertices (V, 3) in the armature's axes, and the bones that lead them.

    `leaders` (V,) are numbers of the bones in `names`, -1 where none leads a vertex.
    """

    points: Array
    leaders: NDArray[np.int64]
    names: list[str]


def skinned_meshes(armature: bpy.types.Object) -> list[bpy.types.Object]:
    """Return the meshes that an armature modifier binds to an armature's vertex groups."""
    return [
        o
        for o in deformed_objects(armature)
        if o.type == "MESH" and any(m.use_vertex_groups for m in _modifiers_of(o, armature))
    ]


def deformed_objects(armature: bpy.types.Object) -> list[bpy.types.Object]:
    """Return the objects, such as meshes and lattices, that an armature modifier moves with an armature."""
    return [o for o in bpy.data.objects if _modifiers_of(o, armature)]


def _modifiers_of(owner: bpy.types.Object, armature: bpy.types.Object) -> list[Any]:
    modifiers: list[Any] = [m for m in owner.modifiers if m.type == "ARMATURE"]
    return [m for m in modifiers if m.object == armature]


def read_skin(armature: bpy.types.Object) -> Skin:
    """Read the skin at rest: modifiers before and beside the armature's are respected. That of a skeleton whose bones
    follow the armature's is led by the bones that they follow.
    """
    own = [bone.name for bone in armature.data.bones if bone.use_deform]
    skeletons = {armature: dict(zip(own, own, strict=True)), **skeletons_following(armature)}
    bound = [(mesh, bones) for skeleton, bones in skeletons.items() for mesh in skinned_meshes(skeleton)]
    names = list(dict.fromkeys(name for bones in skeletons.values() for name in bones.values()))
    numbers = {name: i for i, name in enumerate(names)}
    points, leaders = [np.empty((0, 3))], [np.empty(0, np.int64)]
    to_armature = np.linalg.inv(np.array(armature.matrix_world))
    with _at_rest(skeletons):
        graph = bpy.context.evaluated_depsgraph_get()
        for skin, bones in bound:
            shown = skin.evaluated_get(graph)
            mesh = shown.to_mesh()
            matrix = to_armature @ np.array(skin.matrix_world)
            co = np.empty(3 * len(mesh.vertices), np.float32)
            mesh.vertices.foreach_get("co", co)
            points.append(co.reshape(-1, 3) @ matrix[:3, :3].T + matrix[:3, 3])
            groups = [numbers.get(bones.get(group.name, ""), -1) for group in skin.vertex_groups]
            leaders.append(np.array([_leader(vertex, groups) for vertex in mesh.vertices], np.int64))
            shown.to_mesh_clear()
    return Skin(np.concatenate(points), np.concatenate(leaders), names)


def unbound_vertices(armature: bpy.types.Object) -> dict[str, int]:
    """Return how many vertices no deforming bone moves, by the mesh that is bound to an armature, if there are any.
    Meshes do not count if such vertices may be moved otherwise: by another modifier or armature, the envelope of a bone
    or the bone that carries the mesh.
    """
    deforming = {bone.name for bone in armature.data.bones if bone.use_deform}
    found = {}
    for mesh in skinned_meshes(armature):
        modifiers = list[Any](mesh.modifiers)
        others = [m for m in modifiers if m.type == "ARMATURE" and (m.object != armature or m.use_bone_envelopes)]
        if others or any(m.type in _MOVING for m in modifiers) or mesh.parent_type == "BONE":
            continue
        bones = {group.index for group in mesh.vertex_groups if group.name in deforming}
        loose = [not any(g.group in bones and g.weight > 0 for g in vertex.groups) for vertex in mesh.data.vertices]
        if any(loose):
            found[mesh.name] = sum(loose)
    return found


@contextmanager
def _at_rest(armatures: Collection[bpy.types.Object]) -> Iterator[None]:
    before = {armature: armature.data.pose_position for armature in armatures}
    for armature in armatures:
        armature.data.pose_position = "REST"
    bpy.context.view_layer.update()
    try:
        yield
    finally:
        for armature, position in before.items():
            armature.data.pose_position = position
        bpy.context.view_layer.update()


def _leader(vertex: bpy.types.MeshVertex, groups: list[int]) -> int:
    """Return the bone with most of a vertex's weight, -1 where none has half of it."""
    weights = [(g.weight, groups[g.group]) for g in vertex.groups if g.group < len(groups) and groups[g.group] >= 0]
    if not weights:
        return -1
    most, bone = max(weights)
    return bone if most >= _LEADING_SHARE * sum(weight for weight, _ in weights) else -1
