"""How the performers' bodies are drawn over the footage: their parts, or their bones alone.

Bones that are shown alone are rings around the parts, to take hold of as on a control rig.
"""

from __future__ import annotations

import bpy
import numpy as np

from . import part_meshes
from .body_armature import PART

SHAPE = "KF Mocap Bone"
"""Name of the ring, an object in no scene: Blender keeps it as long as a bone is drawn by it."""
_CORNERS, _CLEAR, _WIRE = 32, 1.1, 2.0  # of the ring; its size over the part's; pixels


def show_model(scene: bpy.types.Scene) -> None:
    """Draw the bodies of all performers as the scene says."""
    part_meshes.show_parts(scene)
    for slot in scene.kfmocap.performers:
        if slot.armature is not None:
            _show_shapes(slot.armature, scene.kfmocap.display == "NONE")


def _show_shapes(armature: bpy.types.Object, shown: bool) -> None:
    """Draw the bones of a body of ours by rings, or as sticks; those of other rigs stay as they are drawn."""
    if not all(PART in bone for bone in armature.data.bones) or part_meshes.is_of_skin(armature):
        return
    if shown:
        _give_shapes(armature)
    armature.data.show_bone_custom_shapes = shown


def _give_shapes(armature: bpy.types.Object) -> None:
    """Draw the bones as rings around their parts, except those to which the animator has given another shape."""
    ring = bpy.data.objects.get(SHAPE) or bpy.data.objects.new(SHAPE, _ring())
    clouds = part_meshes.part_clouds(armature)
    for bone in armature.pose.bones:
        if bone.custom_shape not in (None, ring) or bone.name not in clouds:
            continue
        across, _, deep = np.abs(clouds[bone.name]).max(axis=0) * _CLEAR / bone.length
        bone.custom_shape, bone.custom_shape_wire_width = ring, _WIRE
        bone.custom_shape_scale_xyz = (float(across), 1.0, float(deep))


def _ring() -> bpy.types.Mesh:
    """Return a circle of radius 1 around the middle of a bone of length 1, and the bone itself as a line."""
    mesh = bpy.data.meshes.new(SHAPE)
    turns = np.linspace(0.0, 2.0 * np.pi, _CORNERS, endpoint=False)
    circle = np.stack([np.cos(turns), np.full(_CORNERS, 0.5), np.sin(turns)], axis=1)
    edges = [(i, (i + 1) % _CORNERS) for i in range(_CORNERS)]
    mesh.from_pydata([*circle.tolist(), (0.0, 0.0, 0.0), (0.0, 1.0, 0.0)], [*edges, (_CORNERS, _CORNERS + 1)], [])
    return mesh
