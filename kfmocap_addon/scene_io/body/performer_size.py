"""Height and proportions of a performer's body in a scene, to be read and changed."""

from __future__ import annotations

import bpy
import numpy as np

from ....core.body.measures import proportions
from ....core.errors import BodyError
from . import body_armature, part_meshes


def height(armature: bpy.types.Object) -> float:
    """Return how tall a body stands at rest, from the lowest to the highest vertex of its parts, metres."""
    low, high = _vertical_extent(armature)
    return high - low


def set_height(armature: bpy.types.Object, value: float) -> None:
    """Scale a body uniformly to a height, metres; its keys do not change.

    A body without keys keeps standing where it is: its soles stay at their height.

    Raises
    ------
    BodyError
        It is not a performer's body, or has no height.
    """
    ratio, floor = growth(armature, value)
    body_armature.reshape(armature, proportions.scaled(body_armature.body_from_armature(armature), ratio))
    if armature.animation_data is None or armature.animation_data.action is None:
        armature.location.z += floor - _vertical_extent(armature)[0]


def growth(armature: bpy.types.Object, value: float) -> tuple[float, float]:
    """Return the factor that makes a body as tall as a value, metres, and the height of its soles.

    Raises
    ------
    BodyError
        The body, or the value, is no height.
    """
    low, high = _vertical_extent(armature)
    if not high > low or not value > 0:
        raise BodyError("the body has no height", where=f"armature {armature.name}")
    return value / (high - low), low


def measure(armature: bpy.types.Object, name: str) -> float:
    """Take a measure of a body, see `measures.proportions`, metres; 0 where its bones are not the default body's, or a
    skin fits them.
    """
    if part_meshes.is_of_skin(armature):
        return 0.0
    ends = {bone.name: (tuple(bone.head_local), tuple(bone.tail_local)) for bone in armature.data.bones}
    return proportions.measured(ends, name) or 0.0


def set_measure(armature: bpy.types.Object, name: str, value: float) -> None:
    """Change a measure of a body, on both sides; its keys do not change.

    Raises
    ------
    BodyError
        It is not a performer's body, or has no such measure.
    """
    body_armature.reshape(armature, proportions.with_measure(body_armature.body_from_armature(armature), name, value))


def _vertical_extent(armature: bpy.types.Object) -> tuple[float, float]:
    """Heights of the lowest and the highest vertex of the parts at rest in the world, metres."""
    clouds = part_meshes.part_clouds(armature)
    if not clouds:
        return 0.0, 0.0
    bones = [armature.data.bones[name] for name in clouds]
    matrix = np.array(armature.matrix_world)
    heights = np.concatenate(
        [
            (vertices @ R.T + np.array(bone.head_local)) @ matrix[2, :3] + matrix[2, 3]
            for vertices, bone, R in zip(clouds.values(), bones, body_armature.rest_rotations(bones), strict=True)
        ]
    )
    return float(heights.min()), float(heights.max())
