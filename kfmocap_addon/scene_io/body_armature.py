"""A body as an armature with a mesh on every bone, and back."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace

import bpy
import numpy as np
from mathutils import Vector

from ...core.body import Body, Part
from ...core.body.body import UNLIMITED
from ...core.errors import BodyError
from ...core.numerics import rotations
from ...core.numerics.arrays import Array
from . import lossless, part_meshes
from .sides import SIDES, colour_of, side_of

PART, LIMITS, LANDMARKS, REST = "kfmocap_part", "kfmocap_limits", "kfmocap_landmarks", "kfmocap_rest"
"""Custom properties of a bone: its rank in the body; limits and landmarks as JSON, name: [rank, x, y, z].

They sit on the bones and not in a table of names, so that renaming a bone loses nothing.
"""


def build_armature(body: Body, name: str, collection: bpy.types.Collection) -> bpy.types.Object:
    """Build a body's armature and meshes in a collection.

    Every bone's rest matrix is the part's joint and rest orientation, so a pose bone's rotation is Q.

    Returns
    -------
    bpy.types.Object
        The armature, at the world's origin; its meshes are its children, unselectable, drawn as wire.
    """
    armature = bpy.data.objects.new(name, bpy.data.armatures.new(name))
    with edit_bones(armature) as bones:
        for part in body.parts:
            bone = bones.new(part.name)
            bone.head, bone.tail = Vector(part.head_world.tolist()), Vector(part.tail_world.tolist())
            bone.align_roll(Vector(part.R_world_rest[:, 2].tolist()))
            bone.use_connect = False
            bone.parent = bones[part.parent] if part.parent >= 0 else None
    _describe(armature, body)
    collection.objects.link(armature)
    armature.show_in_front = True
    armature.data.display_type = "STICK"
    for pose_bone in armature.pose.bones:
        pose_bone.rotation_mode = "QUATERNION"
        pose_bone.lock_location = (pose_bone.parent is not None,) * 3
        pose_bone.lock_scale = (True,) * 3
    _sort_by_side(armature)
    for part in body.parts:
        part_meshes.build_mesh(part, armature, collection)
    return armature


def _sort_by_side(armature: bpy.types.Object) -> None:
    """Left, right and middle are bone collections and have colours. The colours are the bones' own: they stay beneath
    those that show expected errors, which are the pose bones'.
    """
    groups = {letter: armature.data.collections.new(label) for letter, (label, _) in SIDES.items()}
    for bone in armature.data.bones:
        groups[side_of(bone.name)].assign(bone)
        bone.color.palette = "CUSTOM"
        colour = bone.color.custom
        colour.normal = colour_of(bone.name)[:3]
        colour.select, colour.active = (1.0, 1.0, 1.0), (0.8, 1.0, 1.0)


def show_colour(armature: bpy.types.Object, colour: Sequence[float]) -> None:
    """Give the bones of the middle a performer's colour, where they have one of their own."""
    for bone in armature.data.bones:
        if bone.color.palette == "CUSTOM" and not side_of(bone.name):
            bone.color.custom.normal = colour


@contextmanager
def edit_bones(armature: bpy.types.Object) -> Iterator[bpy.types.ArmatureEditBones]:
    """Edit mode needs the object in the active view layer: there for the time of the edit, then taken out."""
    layer, home = bpy.context.view_layer, bpy.context.scene.collection
    before, there = layer.objects.active, armature.name in home.objects
    mode = "OBJECT" if before is None else before.mode
    if mode != "OBJECT":
        bpy.ops.object.mode_set(mode="OBJECT")
    if not there:
        home.objects.link(armature)
    hidden = armature.hide_viewport, armature.hide_get()
    armature.hide_viewport = False
    armature.hide_set(False)
    layer.objects.active = armature
    bpy.ops.object.mode_set(mode="EDIT")
    try:
        yield armature.data.edit_bones
    finally:
        bpy.ops.object.mode_set(mode="OBJECT")
        armature.hide_viewport = hidden[0]
        armature.hide_set(hidden[1])
        if not there:
            home.objects.unlink(armature)
        layer.objects.active = before
        if mode != "OBJECT":
            bpy.ops.object.mode_set(mode=mode)


def _describe(armature: bpy.types.Object, body: Body) -> None:
    """Keep on each bone what Blender has no place for."""
    for rank, part in enumerate(body.parts):
        bone = armature.data.bones[part.name]
        bone[PART] = rank
        lossless.keep(bone, REST, _rest(part))
        bone[LIMITS] = json.dumps(np.asarray(part.limits).tolist())
        bone[LANDMARKS] = json.dumps(
            {
                name: [place, *np.asarray(point).tolist()]
                for place, (name, (owner, point)) in enumerate(body.landmarks.items())
                if owner == rank
            }
        )


def reshape(armature: bpy.types.Object, body: Body) -> None:
    """Give an armature the lengths and shapes of another body with the same parts; its keys stay as they are.

    Parameters
    ----------
    body : Body
        As `body_from_armature` gave it, its root where it was, with other joints and vertices.
    """
    R_object, place = object_pose(armature)
    before = {bone.name: bone.length for bone in armature.data.bones}
    with edit_bones(armature) as bones:
        for bone in bones:
            bone.use_connect = False
        for part in body.parts:
            bone = bones[part.name]
            ends = np.stack([part.head_world, part.tail_world]) - place
            bone.head, bone.tail = map(Vector, (ends @ R_object).tolist())
            bone.align_roll(Vector((R_object.T @ part.R_world_rest[:, 2]).tolist()))
    for part in body.parts:
        longer = armature.data.bones[part.name].length - before[part.name]
        part_meshes.put_vertices(armature, part, longer)
    _describe(armature, body)


def object_pose(armature: bpy.types.Object) -> tuple[Array, Array]:
    """Rotation (3, 3) and place (3,) of the armature object in the world, metres.

    Raises
    ------
    BodyError
        If the object is scaled: the bones' lengths would not be the body's.
    """
    matrix = np.array(armature.matrix_world)
    if not np.allclose(matrix[:3, :3].T @ matrix[:3, :3], np.eye(3), atol=1e-5):
        raise BodyError(
            "the armature object is scaled",
            where=f"armature {armature.name}",
            todo="apply its scale (Ctrl A)",
        )
    return rotations.orthonormal(matrix[:3, :3]), matrix[:3, 3]


def body_bones(armature: bpy.types.Object) -> list[bpy.types.Bone]:
    """The bones that are parts of the body, in the body's order: parents before children."""
    carried = part_meshes.meshes_by_bone(armature)
    bones = [bone for bone in armature.data.bones if bone.name in carried or PART in bone]
    if all(PART in bone for bone in bones):
        bones.sort(key=lambda bone: bone[PART])
    if not bones:
        raise BodyError("no bone carries a mesh", where=f"armature {armature.name}", todo="parent meshes to bones")
    return bones


def body_from_armature(armature: bpy.types.Object) -> Body:
    """Read a body back from an armature and the meshes parented to its bones.

    Raises
    ------
    BodyError
        If a bone of the tree carries no mesh, or the bones are not one tree.
    """
    R_object, place = object_pose(armature)
    bones, meshes = body_bones(armature), part_meshes.meshes_by_bone(armature)
    index = {bone.name: i for i, bone in enumerate(bones)}
    parts: list[Part] = []
    for bone, R_rest in zip(bones, rest_rotations(bones), strict=True):
        above = next((p.name for p in bone.parent_recursive if p.name in index), None)
        if above is None and parts:
            raise BodyError(
                f"the bone hangs on no other part: {bones[0].name} is the top of the body",
                where=f"armature {armature.name}, bone {bone.name}",
                todo="parent a mesh to a bone that both hang on, or take this one's off",
            )
        head, tail = (R_object @ np.array(point) + place for point in (bone.head_local, bone.tail_local))
        read = Part(
            name=bone.name,
            parent=-1 if above is None else index[above],
            head_world=head,
            tail_world=tail,
            R_world_rest=R_object @ R_rest,
            vertices=part_meshes.mesh_vertices(armature, bone, meshes.get(bone.name, ())),
            limits=np.array(json.loads(bone[LIMITS]) if LIMITS in bone else UNLIMITED, float),
        )
        part_meshes.check_solid(read.vertices, armature, bone)
        rest = lossless.recall(bone, REST, _rest(read), 1.0 + float(np.abs(head).max()))
        parts.append(
            replace(
                read,
                head_world=rest[0],
                tail_world=rest[1],
                R_world_rest=rest[2:5],
                vertices=rest[5:],
            )
        )
    return Body(tuple(parts), _landmarks(bones))


def _rest(part: Part) -> Array:
    """All that Blender rounds of a part, shape (5 + V, 3): head, tail, rest orientation, vertices."""
    return np.concatenate([[part.head_world, part.tail_world], part.R_world_rest, part.vertices])


def rest_rotation(bone: bpy.types.Bone) -> Array:
    """Rest orientation of a bone in its armature, shape (3, 3)."""
    return rest_rotations([bone])[0]


def rest_rotations(bones: Sequence[bpy.types.Bone]) -> Array:
    """Rest orientations of bones in their armature, shape (B, 3, 3)."""
    return rotations.orthonormal(np.array([bone.matrix_local for bone in bones]).reshape(-1, 4, 4)[:, :3, :3])


def _landmarks(bones: list[bpy.types.Bone]) -> dict[str, tuple[int, Array]]:
    """Landmarks in the order they were defined in; an armature of another origin has its joints."""
    found = [
        (rank, name, i, np.array(point))
        for i, bone in enumerate(bones)
        for name, (rank, *point) in json.loads(bone.get(LANDMARKS, "{}")).items()
    ]
    if not found:
        return {bone.name: (i, np.zeros(3)) for i, bone in enumerate(bones)}
    return {name: (i, point) for _, name, i, point in sorted(found, key=lambda row: row[0])}
