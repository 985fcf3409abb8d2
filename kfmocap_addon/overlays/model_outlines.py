"""The model as outlines over the footage, in the colours of its sides; grey where one part hides another."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import bpy
import gpu
import numpy as np
from gpu_extras.batch import batch_for_shader
from scipy.spatial import QhullError

from ...core.body.silhouette import Solid
from ...core.numerics.arrays import Array
from ..scene_io import active_performer
from ..scene_io.body import part_meshes
from ..scene_io.body.sides import Colour
from ..scene_io.review import bone_confidence
from ..session import SESSION

HIDDEN_COLOUR = (0.6, 0.6, 0.6, 0.55)
_WIDTH = 1.6  # pixels, at a resolution scale of 1
_NEARER = 0.004  # lines lie before the faces they bound, as a share of their distance: on the same spot of the picture
_ORTHOGRAPHIC_DISTANCE = 1e4
_SOLIDS = 256  # parts whose edges and faces are remembered: those of ten bodies


def draw_outlines() -> None:
    """Draw the outlines of all performers' parts into the 3D view that is being drawn."""
    context = bpy.context
    space: Any = context.space_data
    matrix = context.region_data.view_matrix.inverted()
    toward = np.array(matrix.col[2].xyz)
    eye = (
        np.array(matrix.translation) + (0.0 if context.region_data.is_perspective else _ORTHOGRAPHIC_DISTANCE) * toward
    )
    faces: list[Array] = []
    lines: dict[Colour, list[Array]] = {}
    for colour, solid, pose in posed_solids(context.scene, context.evaluated_depsgraph_get(), space):
        world = solid.vertices @ pose[:3, :3].T + pose[:3, 3]
        faces.append(world[solid.triangles].reshape(-1, 3))
        local = (eye - pose[:3, 3]) @ np.linalg.inv(pose[:3, :3]).T
        corners = world[solid.silhouette(local)].reshape(-1, 3)
        lines.setdefault(colour, []).append(corners + _NEARER * (eye - corners))
    if faces:
        coloured = {colour: np.concatenate(parts) for colour, parts in lines.items()}
        width = _WIDTH * context.preferences.system.ui_scale
        _draw(np.concatenate(faces), coloured, width, (context.region.width, context.region.height))


def posed_solids(
    scene: bpy.types.Scene, graph: bpy.types.Depsgraph, space: bpy.types.SpaceView3D
) -> Iterator[tuple[Colour, Solid, Array]]:
    """Colours, convex parts and matrices (4, 4) in the world of the bones of all performers that a 3D view shows, as
    they are evaluated.
    """
    for slot in scene.kfmocap.performers:
        if not active_performer.is_present(scene, slot) or not slot.armature.visible_get(viewport=space):
            continue
        posed = slot.armature.evaluated_get(graph)
        for name, vertices in part_meshes.part_clouds(slot.armature).items():
            try:
                solid = SESSION.remembering(_solid, _SOLIDS)(vertices.tobytes())
            except QhullError:
                continue  # it is being edited
            bone = posed.pose.bones[name]
            yield bone_confidence.outline_colour(scene, slot, bone), solid, np.array(posed.matrix_world @ bone.matrix)


def _solid(vertices: bytes) -> Solid:
    return Solid.of(np.frombuffer(vertices).reshape(-1, 3))


def _positions(points: Array) -> Any:
    """Give points as Blender's shaders take them: an array, which its type stubs do not know."""
    return {"pos": points.astype(np.float32)}


def _draw(faces: Array, lines: dict[Colour, Array], width: float, size: tuple[int, int]) -> None:
    """Fill depth alone with the faces, then draw the lines of each colour before it and behind it."""
    state, fill = gpu.state, gpu.shader.from_builtin("UNIFORM_COLOR")
    stroke = gpu.shader.from_builtin("POLYLINE_UNIFORM_COLOR")
    framebuffer: Any = state.active_framebuffer_get
    framebuffer().clear(depth=1.0)
    state.depth_mask_set(True)
    state.depth_test_set("LESS_EQUAL")
    state.color_mask_set(False, False, False, False)
    batch_for_shader(fill, "TRIS", _positions(faces)).draw(fill)
    state.color_mask_set(True, True, True, True)
    state.depth_mask_set(False)
    state.blend_set("ALPHA")
    batches = {colour: batch_for_shader(stroke, "LINES", _positions(ends)) for colour, ends in lines.items()}
    stroke.uniform_float("viewportSize", size)
    for test, share in (("GREATER", 0.7), ("LESS_EQUAL", 1.0)):
        state.depth_test_set(test)
        stroke.uniform_float("lineWidth", share * width)
        for colour, batch in batches.items():
            stroke.uniform_float("color", HIDDEN_COLOUR if test == "GREATER" else colour)
            batch.draw(stroke)
    state.depth_test_set("NONE")
    state.blend_set("NONE")
