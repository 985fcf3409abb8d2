"""The size of a character whose parts are made of its skin: it is scaled as a whole, as its rig and skin fit together
in one proportion only.
"""

from __future__ import annotations

import bpy
import numpy as np
from mathutils import Matrix, Vector

from .. import fcurves
from ..body import body_armature, part_meshes, performer_size
from .followed_bones import skeletons_following
from .skins import skinned_meshes


def set_height(armature: bpy.types.Object, value: float) -> None:
    """Make a performer's body as tall as a value, metres; its keys do not change, or stay over the footage.

    Raises
    ------
    BodyError
        It is not a performer's body, or has no height.
    """
    if part_meshes.is_of_skin(armature):
        _scale_character(armature, *performer_size.growth(armature, value))
    else:
        performer_size.set_height(armature, value)


def _scale_character(armature: bpy.types.Object, ratio: float, floor: float) -> None:
    """Scale the objects of a character about the point of a floor, at a height in metres, below its armature.

    Key poses stay where they are over the footage: keys of the place of the topmost part are moved.
    """
    about = Vector((armature.matrix_world.translation.x, armature.matrix_world.translation.y, floor))
    bones = body_armature.body_bones(armature)
    frames, sizes = body_armature.standing_frames(armature, bones)
    fixed = np.array(armature.matrix_world.inverted() @ about)
    shift = frames[0, :3, :3].T @ (fixed - frames[0, :3, 3]) * (1 - 1 / ratio) / sizes[0]
    scaling = Matrix.Translation(about) @ Matrix.Scale(ratio, 4) @ Matrix.Translation(-about)
    for member in _members(armature):
        member.matrix_world = scaling @ member.matrix_world
    _move_keys(armature, bones[0].name, 1 / ratio, shift.tolist())
    bpy.context.view_layer.update()


def _members(armature: bpy.types.Object) -> list[bpy.types.Object]:
    """Return an armature, the skeletons that follow it, and their skins, but for those that hang on others of them."""
    armatures = [armature, *skeletons_following(armature)]
    found = list(dict.fromkeys([*armatures, *(skin for each in armatures for skin in skinned_meshes(each))]))
    return [member for member in found if not any(member in other.children_recursive for other in found)]


def _move_keys(armature: bpy.types.Object, bone: str, factor: float, shift: list[float]) -> None:
    """Multiply the keys of a bone's location, and what it shows of them, and add a shift, by axis."""
    bag, shown = fcurves.find_channelbag(armature), armature.pose.bones[bone].location
    for axis in range(3):
        curve = None if bag is None else bag.fcurves.find(fcurves.bone_path(bone, "location"), index=axis)
        if curve is None:
            continue
        shown[axis] = factor * shown[axis] + shift[axis]
        for key in curve.keyframe_points:
            sides = key.handle_left.y, key.handle_right.y
            key.co.y = factor * key.co.y + shift[axis]
            key.handle_left.y, key.handle_right.y = (factor * side + shift[axis] for side in sides)
        curve.update()
