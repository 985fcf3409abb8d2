"""A body as an armature with a mesh on every bone, and back."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace

import bpy
import numpy as np
from mathutils import Vector

from ....core.body import Body, Part
from ....core.body.body import REST_SIGMA, UNLIMITED
from ....core.errors import BodyError
from ....core.numerics import rotations
from ....core.numerics.arrays import Array
from .. import lossless
from ..constraints import acts
from ..linked import linked_file
from . import part_meshes
from .armature_landmarks import keep_landmarks, landmarks_of
from .sides import SIDES, colour_of, side_of

PART, LIMITS, REST = "kfmocap_part", "kfmocap_limits", "kfmocap_rest"
DEPARTURE = "kfmocap_departure"
"""Custom properties of a bone: its rank in the body; limits as JSON; its rest orientation; how far it usually is from
that, radians.

They sit on the bones and not in a table of names, so that renaming a bone loses nothing.
"""
ABOVE = "kfmocap_above"
"""Custom property of a bone: the bone that it moves with by constraints, as if it were its parent."""


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
    """Put the bones of each side and of the middle into a bone collection, with a colour. The colour is set on the
    bones, so that it stays beneath the colours of expected errors, which are set on the pose bones.
    """
    groups = {letter: armature.data.collections.new(label) for letter, (label, _) in SIDES.items()}
    for bone in armature.data.bones:
        groups[side_of(bone.name)].assign(bone)
        bone.color.palette = "CUSTOM"
        colour = bone.color.custom
        colour.normal = colour_of(bone.name)[:3]
        colour.select, colour.active = (1.0, 1.0, 1.0), (0.8, 1.0, 1.0)


def show_colour(armature: bpy.types.Object, colour: Sequence[float]) -> None:
    """Set the colour of the bones of the middle to the performer's, unless they have no colour."""
    for bone in armature.data.bones:
        if bone.color.palette == "CUSTOM" and not side_of(bone.name):
            bone.color.custom.normal = colour


@contextmanager
def edit_bones(armature: bpy.types.Object) -> Iterator[bpy.types.ArmatureEditBones]:
    """Provide the edit bones of an armature, which is put into the active view layer meanwhile, as edit mode
    requires.

    Raises
    ------
    BodyError
        It is linked from another file.
    """
    if file := linked_file(armature.data):
        what = f"its bones are linked from {file}, and cannot be changed in this file"
        todo = "change them in that file, or append the character instead of linking it"
        raise BodyError(what, where=f"armature {armature.name}", todo=todo)
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
    """Store on each bone what Blender has no property for."""
    for rank, part in enumerate(body.parts):
        bone = armature.data.bones[part.name]
        bone[PART] = rank
        lossless.keep(bone, REST, _rest(part))
        bone[DEPARTURE] = part.departure
        bone[LIMITS] = json.dumps(np.asarray(part.limits).tolist())
    keep_landmarks(armature, body)


def reshape(armature: bpy.types.Object, body: Body) -> None:
    """Change an armature to the lengths and shapes of another body with the same parts; its keys do not change.

    Parameters
    ----------
    body : Body
        As `body_from_armature` gave it, its root where it was, with other joints and vertices.
    """
    R_object, place, scale = object_pose(armature)
    before = {bone.name: bone.length for bone in armature.data.bones}
    carried = dict(
        zip(body.names, _carrying(armature, [armature.data.bones[name] for name in body.names]), strict=True)
    )
    with edit_bones(armature) as bones:
        for bone in bones:
            bone.use_connect = False
        for part in body.parts:
            bone, to_rest = bones[part.name], np.linalg.inv(carried[part.name])
            ends = (np.stack([part.head_world, part.tail_world]) - place) @ R_object / scale
            bone.head, bone.tail = map(Vector, (ends @ to_rest[:3, :3].T + to_rest[:3, 3]).tolist())
            bone.align_roll(Vector((to_rest[:3, :3] @ R_object.T @ part.R_world_rest[:, 2]).tolist()))
    for part in body.parts:
        longer = armature.data.bones[part.name].length - before[part.name]
        unit = scale * _size(carried[part.name])
        part_meshes.put_vertices(armature, part.name, part.vertices / unit, longer)
    _describe(armature, body)


def world_frame(armature: bpy.types.Object) -> tuple[Array, float]:
    """Return the matrix (4, 4) of an armature in the world, and its scale.

    Raises
    ------
    BodyError
        It is scaled by different amounts along its axes, mirrored, or of no size.
    """
    matrix, scale = _evenly_scaled(armature)
    if scale > 0:
        return matrix, scale
    chain = [armature]
    while chain[-1].parent is not None:
        chain.append(chain[-1].parent)
    owner = next(each for each in reversed(chain) if not _evenly_scaled(each)[1])  # what it hangs on, or itself
    here, todo = np.array(owner.matrix_world)[:3, :3], "apply its scale (Ctrl A)"
    how = "mirrored" if np.linalg.det(here) < 0 else "scaled by different amounts along its axes"
    if not here.any():
        how, todo = "scaled to nothing", "clear its scale (Alt S)"
    raise BodyError(
        f"the {'armature' if owner == armature else owner.name} object is {how}",
        where=f"armature {armature.name}",
        todo=f"{todo}{'' if owner == armature else ', or clear the parent (Alt P)'}",
    )


def _evenly_scaled(owner: bpy.types.Object) -> tuple[Array, float]:
    """Return an object's matrix (4, 4) in the world, and its scale; 0 where this differs along its axes."""
    matrix = np.array(owner.matrix_world)
    scale = float(np.cbrt(max(np.linalg.det(matrix[:3, :3]), 0.0)))
    turned = matrix[:3, :3] / max(scale, 1e-12)
    return matrix, scale if np.allclose(turned.T @ turned, np.eye(3), atol=1e-3) else 0.0


def object_pose(armature: bpy.types.Object) -> tuple[Array, Array, float]:
    """Return the rotation (3, 3) and place (3,) of the armature object in the world, metres, and how many metres its
    unit is.

    Raises
    ------
    BodyError
        See `world_frame`.
    """
    matrix, scale = world_frame(armature)
    return rotations.orthonormal(matrix[:3, :3] / scale), matrix[:3, 3], scale


def body_bones(armature: bpy.types.Object) -> list[bpy.types.Bone]:
    """Return the bones that are parts of the body, in the body's order: parents before children."""
    carried = part_meshes.meshes_by_bone(armature)
    bones = [bone for bone in armature.data.bones if bone.name in carried or PART in bone]
    if all(PART in bone for bone in bones):
        bones.sort(key=lambda bone: bone[PART])
    elif any(ABOVE in bone for bone in bones):
        names = {bone.name for bone in bones}
        bones.sort(key=lambda bone: len(names & {above.name for above in bones_above(bone)}))
    if not bones:
        raise BodyError("no bone carries a mesh", where=f"armature {armature.name}", todo="parent meshes to bones")
    return bones


def parents_of(bones: Sequence[bpy.types.Bone]) -> list[int]:
    """Return the place of the part that each part of a body hangs on, -1 for none: the nearest bone above that is
    one.
    """
    index = {bone.name: i for i, bone in enumerate(bones)}
    return [next((index[above.name] for above in bones_above(bone) if above.name in index), -1) for bone in bones]


def bones_above(bone: bpy.types.Bone) -> list[bpy.types.Bone]:
    """Return the bones that a bone of a body hangs on, the nearest first."""
    above = bone.id_data.bones.get(bone.get(ABOVE, ""))
    return list(bone.parent_recursive) if above is None else [above, *bones_above(above)]


def body_from_armature(armature: bpy.types.Object) -> Body:
    """Read a body back from an armature and the meshes parented to its bones.

    Raises
    ------
    BodyError
        If a bone of the tree carries no mesh, or the bones are not one tree.
    """
    R_object, place, scale = object_pose(armature)
    bones, meshes = body_bones(armature), part_meshes.meshes_by_bone(armature)
    parts: list[Part] = []
    frames, sizes = standing_frames(armature, bones)
    for bone, above, frame, size in zip(bones, parents_of(bones), frames, sizes, strict=True):
        if above < 0 and parts:
            raise BodyError(
                f"the bone hangs on no other part: {bones[0].name} is the top of the body",
                where=f"armature {armature.name}, bone {bone.name}",
                todo="parent a mesh to a bone that both hang on, or take this one's off",
            )
        R_rest, start = frame[:3, :3], frame[:3, 3]
        head, tail = (scale * R_object @ point + place for point in (start, start + size * bone.length * R_rest[:, 1]))
        read = Part(
            name=bone.name,
            parent=above,
            head_world=head,
            tail_world=tail,
            R_world_rest=R_object @ R_rest,
            vertices=scale * size * part_meshes.mesh_vertices(armature, bone, meshes.get(bone.name, ())),
            limits=np.array(json.loads(bone[LIMITS]))
            if LIMITS in bone
            else joint_limits(armature.pose.bones[bone.name]),
            departure=bone.get(DEPARTURE, REST_SIGMA),
        )
        part_meshes.check_solid(read.vertices, armature, bone)
        rest = lossless.recall(bone, REST, _rest(read), 1.0 + float(np.abs(head).max()))
        parts.append(replace(read, head_world=rest[0], tail_world=rest[1], R_world_rest=rest[2:5], vertices=rest[5:]))
    return Body(tuple(parts), landmarks_of(bones, meshes))


def _rest(part: Part) -> Array:
    """All that Blender rounds of a part, shape (5 + V, 3): head, tail, rest orientation, vertices."""
    return np.concatenate([[part.head_world, part.tail_world], part.R_world_rest, part.vertices])


def standing_frames(armature: bpy.types.Object, bones: Sequence[bpy.types.Bone]) -> tuple[Array, Array]:
    """Return the frames (B, 4, 4) in the armature of the bones of a body, unposed, and their sizes (B,); all other
    bones stand as they are posed.

    So a control that all bones hang on, or one between two parts, may have been moved, or scaled, once and for all.
    """
    carrying = _carrying(armature, bones)
    frames = carrying @ np.array([np.array(bone.matrix_local) for bone in bones])
    frames[:, :3, :3] = rotations.orthonormal(frames[:, :3, :3])
    return frames, np.array([_size(matrix) for matrix in carrying])


def _carrying(armature: bpy.types.Object, bones: Sequence[bpy.types.Bone]) -> Array:
    """Return how the bones above each bone of a body that are no parts move it from rest, (B, 4, 4) in the armature.

    A bone above all parts that constraints move (Rigify's torso follows its root so) stands where Blender shows it.
    """
    found: dict[str, Array] = {}
    for bone in bones:
        carried = np.eye(4)
        above = bones_above(bone)
        part = next((each.name for each in above if each.name in found), None)
        for between in above:
            posed, rest = armature.pose.bones[between.name], np.array(between.matrix_local)
            if between.name == part:
                carried = found[part] @ carried
                break
            if part is None and is_held(posed):
                carried = np.array(posed.matrix) @ np.linalg.inv(rest) @ carried
                break
            if not np.allclose(np.array(posed.matrix_basis), np.eye(4), atol=1e-6):
                carried = rest @ np.array(posed.matrix_basis) @ np.linalg.inv(rest) @ carried
        found[bone.name] = carried
    return np.array([found[bone.name] for bone in bones])


def is_held(bone: bpy.types.PoseBone) -> bool:
    """Whether a constraint acts on a bone."""
    return any(acts(held) for held in bone.constraints)


def _size(matrix: Array) -> float:
    """Return by how much a matrix (4, 4) enlarges."""
    return float(np.cbrt(np.linalg.det(matrix[:3, :3])))


def joint_limits(bone: bpy.types.PoseBone) -> Array:
    """Limits of a bone's rotation vector, radians, shape (3, 2): its locked axes, and those of Limit Rotation.

    A constraint counts where it limits the bone's own rotation: in local space, at full influence.
    """
    limits = np.array(UNLIMITED, float)
    for held in bone.constraints:
        if held.type == "LIMIT_ROTATION" and held.owner_space == "LOCAL" and not held.mute and held.influence == 1:
            for k, axis in enumerate("xyz"):
                if getattr(held, f"use_limit_{axis}"):
                    limits[k] = getattr(held, f"min_{axis}"), getattr(held, f"max_{axis}")
    limits[np.array(bone.lock_rotation)] = 0.0
    return limits


def rest_rotations(bones: Sequence[bpy.types.Bone]) -> Array:
    """Rest orientations of bones in their armature, shape (B, 3, 3)."""
    return rotations.orthonormal(np.array([bone.matrix_local for bone in bones]).reshape(-1, 4, 4)[:, :3, :3])
