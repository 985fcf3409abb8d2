"""What Blender shows of characters: the vertices of their meshes on frames of the scene."""

from __future__ import annotations

from collections.abc import Sequence

import bpy
import numpy as np

from ...core.numerics.arrays import Array
from ...kfmocap_addon.scene_io.characters.skins import skinned_meshes


def meshes_of(armature: bpy.types.Object) -> list[bpy.types.Object]:
    """Return what is seen of a character: its skins, or the meshes that hang on its bones."""
    return skinned_meshes(armature) or [child for child in armature.children if child.parent_type == "BONE"]


def shown_vertices(meshes: Sequence[bpy.types.Object]) -> Array:
    """Return the evaluated vertices of meshes on the present frame, world frame, metres, shape (V, 3)."""
    graph = bpy.context.evaluated_depsgraph_get()
    points = []
    for owner in meshes:
        posed = owner.evaluated_get(graph)
        mesh = posed.to_mesh()
        local = np.empty(3 * len(mesh.vertices), np.float32)
        mesh.vertices.foreach_get("co", local)
        matrix = np.array(posed.matrix_world)
        points.append(local.reshape(-1, 3) @ matrix[:3, :3].T + matrix[:3, 3])
        posed.to_mesh_clear()
    return np.concatenate(points)


def vertices_on_frames(meshes: Sequence[bpy.types.Object]) -> Array:
    """Return the vertices of meshes on every frame of the scene, see `shown_vertices`, shape (F, V, 3)."""
    scene, shown = bpy.context.scene, []
    for frame in range(scene.frame_start, scene.frame_end + 1):
        scene.frame_set(frame)
        shown.append(shown_vertices(meshes))
    return np.array(shown)
