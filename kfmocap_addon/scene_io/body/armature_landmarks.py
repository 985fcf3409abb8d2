"""Landmarks of a body, stored with its armature."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence

import bpy
import numpy as np

from ....core.body import Body
from ....core.numerics.arrays import Array
from ..linked import linked_file
from . import part_meshes

LANDMARKS = "kfmocap_landmarks"
"""Custom property of a bone: landmarks of its part as JSON, name: [rank, x, y, z].

Landmarks of a body whose bones are linked from another file sit on the meshes of its parts.
"""


def keep_landmarks(armature: bpy.types.Object, body: Body) -> None:
    """Store the landmarks of a body on the bones of its armature or, where these are of a linked file, on the meshes of
    its parts.
    """
    meshes = part_meshes.meshes_by_bone(armature)
    for rank, part in enumerate(body.parts):
        owned = {
            name: [place, *np.asarray(point).tolist()]
            for place, (name, (owner, point)) in enumerate(body.landmarks.items())
            if owner == rank
        }
        bone = armature.data.bones[part.name]
        keepers = [each for each in (bone, *meshes.get(part.name, ())) if not linked_file(each.id_data)]
        if keepers:
            keepers[0][LANDMARKS] = json.dumps(owned)


def has_landmarks(armature: bpy.types.Object) -> bool:
    """Whether landmarks are stored for an armature's body."""
    meshes = part_meshes.meshes_by_bone(armature)
    return any(_stored_landmarks(bone, meshes.get(bone.name, ())) for bone in armature.data.bones)


def _stored_landmarks(bone: bpy.types.Bone, meshes: Sequence[bpy.types.Object]) -> dict[str, list[float]]:
    """Return the landmarks of the part of a bone, with its meshes: rank and place by name."""
    keeper = next((each for each in (bone, *meshes) if LANDMARKS in each), None)
    found: dict[str, list[float]] = {} if keeper is None else json.loads(keeper[LANDMARKS])
    return found


def landmarks_of(
    bones: Sequence[bpy.types.Bone], meshes: Mapping[str, Sequence[bpy.types.Object]]
) -> dict[str, tuple[int, Array]]:
    """Landmarks in the order they were defined in; an armature of another origin has its joints."""
    found = [
        (rank, name, i, np.array(point))
        for i, bone in enumerate(bones)
        for name, (rank, *point) in _stored_landmarks(bone, meshes.get(bone.name, ())).items()
    ]
    if not found:
        return {bone.name: (i, np.zeros(3)) for i, bone in enumerate(bones)}
    return {name: (i, point) for _, name, i, point in sorted(found, key=lambda row: row[0])}
