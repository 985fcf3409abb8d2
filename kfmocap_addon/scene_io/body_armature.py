"""The body in Blender: an armature, and the parts' polyhedra as meshes parented to its bones."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace

import bmesh
import bpy
import numpy as np
from mathutils import Matrix, Vector
from numpy.typing import NDArray
from scipy.spatial import ConvexHull, QhullError

from ...core.body import Body, Part
from ...core.body.body import UNLIMITED
from ...core.errors import BodyError
from ...core.numerics import rotations
from . import lossless

Array = NDArray[np.float64]

PART, LIMITS, LANDMARKS, REST = "kfmocap_part", "kfmocap_limits", "kfmocap_landmarks", "kfmocap_rest"
"""Custom properties of a bone: its rank in the body; limits and landmarks as JSON, name: [rank, x, y, z].

They sit on the bones and not in a table of names, so that renaming a bone loses nothing.
"""


_FLAT = np.radians(20)


def build_armature(body: Body, name: str, collection: bpy.types.Collection) -> bpy.types.Object:
    """Build a body's armature and meshes in a collection.

    Every bone's rest matrix is the part's joint and rest orientation, so a pose bone's rotation is Q.

    Returns
    -------
    bpy.types.Object
        The armature, at the world's origin; its meshes are its children, unselectable, drawn as wire.
    """
    armature = bpy.data.objects.new(name, bpy.data.armatures.new(name))
    with _edit_bones(armature) as bones:
        for part in body.parts:
            bone = bones.new(part.name)
            bone.head, bone.tail = part.head_world, part.tail_world
            bone.align_roll(Vector(part.R_world_rest[:, 2]))
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
    for part in body.parts:
        _build_mesh(part, armature, collection)
    return armature


@contextmanager
def _edit_bones(armature: bpy.types.Object) -> Iterator[bpy.types.ArmatureEditBones]:
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


def _build_mesh(part: Part, armature: bpy.types.Object, collection: bpy.types.Collection) -> None:
    name = f"{armature.name} {part.name}"
    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata(part.vertices.tolist(), [], part.faces.tolist())
    _join_triangles(mesh)
    child = bpy.data.objects.new(name, mesh)
    collection.objects.link(child)
    child.parent, child.parent_type, child.parent_bone = armature, "BONE", part.name
    # Blender hangs children on the bone's tail; the part's frame is at its head.
    child.matrix_parent_inverse = Matrix.Translation((0.0, -armature.data.bones[part.name].length, 0.0))
    child.hide_select = child.show_in_front = True
    child.display_type, child.color = "WIRE", (1.0, 1.0, 1.0, 1.0)


def _join_triangles(mesh: bpy.types.Mesh) -> None:
    """Take out edges between triangles that are nearly in one plane: the wire shall not hide the footage."""
    bm = bmesh.new()
    bm.from_mesh(mesh)
    bmesh.ops.join_triangles(bm, faces=bm.faces, angle_face_threshold=_FLAT, angle_shape_threshold=np.pi, cmp_uvs=False)
    bm.to_mesh(mesh)
    bm.free()


def reshape(armature: bpy.types.Object, body: Body) -> None:
    """Give an armature the lengths and shapes of another body with the same parts; its keys stay as they are.

    Parameters
    ----------
    body : Body
        As `body_from_armature` gave it, its root where it was, with other joints and vertices.
    """
    R_object, place = object_pose(armature)
    before = {bone.name: bone.length for bone in armature.data.bones}
    with _edit_bones(armature) as bones:
        for bone in bones:
            bone.use_connect = False
        for part in body.parts:
            bone = bones[part.name]
            bone.head, bone.tail = (part.head_world - place) @ R_object, (part.tail_world - place) @ R_object
            bone.align_roll(Vector(R_object.T @ part.R_world_rest[:, 2]))
    for part in body.parts:
        longer = armature.data.bones[part.name].length - before[part.name]
        _put_vertices(armature, part, longer)
    _describe(armature, body)


def _put_vertices(armature: bpy.types.Object, part: Part, longer: float) -> None:
    """Move the vertices of the meshes on a bone that grew; inverse of `_vertices`."""
    length, start = armature.data.bones[part.name].length, 0
    for child in meshes_on(armature, part.name):
        child.matrix_parent_inverse = Matrix.Translation((0.0, -longer, 0.0)) @ child.matrix_parent_inverse
        to_part, count = _to_bone_tail(child), len(child.data.vertices)
        points = part.vertices[start : start + count] - [0.0, length, 0.0] - to_part[:3, 3]
        child.data.vertices.foreach_set("co", (points @ np.linalg.inv(to_part[:3, :3]).T).astype(np.float32).ravel())
        child.data.update()
        start += count


def check_part(child: bpy.types.Object) -> None:
    """See that a part's mesh can be one.

    Raises
    ------
    BodyError
        It encloses no volume.
    """
    bone = child.parent.data.bones[child.parent_bone]
    _check_solid(_vertices(child.parent, bone, meshes_on(child.parent, bone.name)), child.parent, bone)


def _check_solid(vertices: Array, armature: bpy.types.Object, bone: bpy.types.Bone) -> None:
    try:
        ConvexHull(vertices)
    except (QhullError, ValueError) as error:
        raise BodyError(
            "the mesh on the bone is flat: it encloses no volume",
            where=f"armature {armature.name}, bone {bone.name}",
            todo="give it four corners at least that are not in one plane",
        ) from error


def mirror_part(child: bpy.types.Object) -> None:
    """Give the same part of the other side the mirrored shape of a part's mesh, where there is such a part."""
    armature = child.parent
    bone, other = (armature.data.bones.get(n) for n in (child.parent_bone, bpy.utils.flip_name(child.parent_bone)))
    if other is None or other == bone:
        return
    targets = meshes_on(armature, other.name)
    if not targets:
        return
    target, ratio = targets[0], other.length / bone.length
    across = Matrix.Diagonal((-1.0, ratio, 1.0, 1.0))  # a bone's frame is mirrored along its x axis
    to_frame = Matrix.Translation((0.0, bone.length, 0.0)) @ Matrix(_to_bone_tail(child))
    from_frame = Matrix.Translation((0.0, other.length, 0.0)) @ Matrix(_to_bone_tail(target))
    bm = bmesh.new()
    bm.from_mesh(child.data)
    bm.transform(from_frame.inverted() @ across @ to_frame)
    bmesh.ops.reverse_faces(bm, faces=bm.faces)
    bm.to_mesh(target.data)
    bm.free()
    target.data.update()


def show_parts(scene: bpy.types.Scene) -> None:
    """Draw the parts of all performers as the scene says: as wire, solid, or not, where outlines are drawn instead."""
    display = scene.kfmocap.display
    for slot in scene.kfmocap.performers:
        for child in _meshes(slot.armature) if slot.armature is not None else ():
            if child.hide_select:  # it is not being edited
                child.hide_viewport = display in ("OUTLINE", "NONE")
                child.display_type = "SOLID" if display == "SOLID" else "WIRE"
                child.color = (1.0, 1.0, 1.0, 1.0)


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
    carried = _meshes_by_bone(armature)
    bones = [bone for bone in armature.data.bones if bone.name in carried or PART in bone]
    if all(PART in bone for bone in bones):
        bones.sort(key=lambda bone: bone[PART])
    if not bones:
        raise BodyError("no bone carries a mesh", where=f"armature {armature.name}", todo="parent meshes to bones")
    return bones


def _meshes(armature: bpy.types.Object) -> list[bpy.types.Object]:
    return [c for c in armature.children if c.type == "MESH" and c.parent_type == "BONE"]


def meshes_on(armature: bpy.types.Object, bone: str) -> list[bpy.types.Object]:
    """The meshes that a bone carries."""
    return _meshes_by_bone(armature).get(bone, [])


def _meshes_by_bone(armature: bpy.types.Object) -> dict[str, list[bpy.types.Object]]:
    """All of them at once: an object's children are looked for among all objects of the file."""
    found: dict[str, list[bpy.types.Object]] = {}
    for child in _meshes(armature):
        found.setdefault(child.parent_bone, []).append(child)
    return found


def _to_bone_tail(child: bpy.types.Object) -> Array:
    """Matrix (4, 4) from a mesh to the tail of the bone it hangs on."""
    return np.array(child.matrix_parent_inverse) @ np.array(child.matrix_basis)


def body_from_armature(armature: bpy.types.Object) -> Body:
    """Read a body back from an armature and the meshes parented to its bones.

    Raises
    ------
    BodyError
        If a bone of the tree carries no mesh, or the bones are not one tree.
    """
    R_object, place = object_pose(armature)
    bones, meshes = body_bones(armature), _meshes_by_bone(armature)
    index = {bone.name: i for i, bone in enumerate(bones)}
    parts = []
    for bone in bones:
        if bone.parent is not None and bone.parent.name not in index:
            raise BodyError(
                "the bone carries no mesh, but a bone below it does",
                where=f"armature {armature.name}, bone {bone.parent.name}",
                todo="parent a mesh to it",
            )
        head, tail = (R_object @ np.array(point) + place for point in (bone.head_local, bone.tail_local))
        read = Part(
            name=bone.name,
            parent=index[bone.parent.name] if bone.parent else -1,
            head_world=head,
            tail_world=tail,
            R_world_rest=R_object @ rest_rotation(bone),
            vertices=_vertices(armature, bone, meshes.get(bone.name, ())),
            limits=np.array(json.loads(bone[LIMITS]) if LIMITS in bone else UNLIMITED, float),
        )
        _check_solid(read.vertices, armature, bone)
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
    return rotations.orthonormal(np.array(bone.matrix_local)[:3, :3])


def part_clouds(armature: bpy.types.Object) -> dict[str, Array]:
    """Vertices of the meshes on every bone that carries some, by its name, in the part's frame, shape (V, 3)."""
    bones = armature.data.bones
    return {name: _vertices(armature, bones[name], m) for name, m in _meshes_by_bone(armature).items() if name in bones}


def _vertices(armature: bpy.types.Object, bone: bpy.types.Bone, meshes: Sequence[bpy.types.Object]) -> Array:
    """Vertices of all meshes on a bone, in the part's frame, shape (V, 3)."""
    clouds = []
    for child in meshes:
        if child.mode == "EDIT":
            child.update_from_editmode()
        local = _to_bone_tail(child)
        points = np.empty(3 * len(child.data.vertices), np.float32)
        child.data.vertices.foreach_get("co", points)
        clouds.append(points.reshape(-1, 3) @ local[:3, :3].T + local[:3, 3] + [0.0, bone.length, 0.0])
    if not clouds:
        raise BodyError(
            "the bone carries no mesh",
            where=f"armature {armature.name}, bone {bone.name}",
            todo="parent one to it",
        )
    return np.concatenate(clouds)


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
