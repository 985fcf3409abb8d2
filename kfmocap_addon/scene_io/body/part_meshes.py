"""The parts of a body as meshes on the bones of its armature."""

from __future__ import annotations

from collections.abc import Sequence

import bmesh
import bpy
import numpy as np
from mathutils import Matrix

from ....core.body import Part
from ....core.errors import BodyError
from ....core.numerics.arrays import Array

OF_SKIN = "kfmocap_of_skin"
"""Custom property of a mesh that was made of a character's skin."""
_FLAT_ANGLE = np.radians(20)
"""Angle between triangles within which they are drawn as one face."""
_MIN_THICKNESS_RATIO = 1e-6
"""Thickness, as a share of the length, that roundings of a plane's vertices in single precision can reach."""


def build_mesh(part: Part, armature: bpy.types.Object, collection: bpy.types.Collection) -> bpy.types.Object:
    """Build the mesh of a part on its bone; returns the mesh."""
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
    return child


def _join_triangles(mesh: bpy.types.Mesh) -> None:
    """Dissolve edges between triangles that are nearly in one plane, so that the wireframe hides less of the
    footage.
    """
    bm = bmesh.new()
    bm.from_mesh(mesh)
    bmesh.ops.join_triangles(
        bm, faces=list(bm.faces), angle_face_threshold=_FLAT_ANGLE, angle_shape_threshold=np.pi, cmp_uvs=False
    )
    bm.to_mesh(mesh)
    bm.free()


def put_vertices(armature: bpy.types.Object, name: str, vertices: Array, longer: float) -> None:
    """Move the vertices of the meshes on a bone that grew to places (V, 3) in its frame; inverse of `mesh_vertices`."""
    length, start = armature.data.bones[name].length, 0
    for child in meshes_on(armature, name):
        child.matrix_parent_inverse = Matrix.Translation((0.0, -longer, 0.0)) @ child.matrix_parent_inverse
        to_part, count = _to_bone_tail(child), len(child.data.vertices)
        points = vertices[start : start + count] - [0.0, length, 0.0] - to_part[:3, 3]
        child.data.vertices.foreach_set("co", (points @ np.linalg.inv(to_part[:3, :3]).T).astype(np.float32).ravel())
        child.data.update()
        start += count


def check_part(child: bpy.types.Object) -> None:
    """Check that a part's mesh encloses a volume.

    Raises
    ------
    BodyError
        It encloses no volume.
    """
    bone = child.parent.data.bones[child.parent_bone]
    check_solid(mesh_vertices(child.parent, bone, meshes_on(child.parent, bone.name)), child.parent, bone)


def check_solid(vertices: Array, armature: bpy.types.Object, bone: bpy.types.Bone) -> None:
    """Raise a BodyError where vertices (V, 3) on a bone enclose no volume."""
    if len(vertices) < 4 or not np.isfinite(vertices).all() or _thickness(vertices) < _MIN_THICKNESS_RATIO:
        raise BodyError(
            "the mesh on the bone is flat: it encloses no volume",
            where=f"armature {armature.name}, bone {bone.name}",
            todo="give it at least four corners that are not in one plane",
        )


def _thickness(vertices: Array) -> float:
    """Extent of vertices (V, 3) along their least axis over that along their greatest."""
    extents = np.linalg.svd(vertices - vertices.mean(axis=0), compute_uv=False)
    return float(extents[2] / max(extents[0], np.finfo(float).tiny))


def mirror_part(child: bpy.types.Object) -> None:
    """Copy the shape of a part's mesh, mirrored, to the same part on the other side, if there is one."""
    armature = child.parent
    bone, other = (armature.data.bones.get(n) for n in (child.parent_bone, bpy.utils.flip_name(child.parent_bone)))
    if other is None or other == bone:
        return
    targets = meshes_on(armature, other.name)
    if not targets:
        return
    target, ratio = targets[0], other.length / bone.length
    across = Matrix.Diagonal((-1.0, ratio, 1.0, 1.0))  # a bone's frame is mirrored along its x axis
    to_frame = Matrix.Translation((0.0, bone.length, 0.0)) @ Matrix(_to_bone_tail(child).tolist())
    from_frame = Matrix.Translation((0.0, other.length, 0.0)) @ Matrix(_to_bone_tail(target).tolist())
    bm = bmesh.new()
    bm.from_mesh(child.data)
    bm.transform(from_frame.inverted() @ across @ to_frame)
    bmesh.ops.reverse_faces(bm, faces=list(bm.faces))
    bm.to_mesh(target.data)
    bm.free()
    target.data.update()


def show_parts(scene: bpy.types.Scene) -> None:
    """Draw the parts of all performers as the scene says: as wire, solid, or not, where outlines are drawn instead."""
    display = scene.kfmocap.display
    for slot in scene.kfmocap.performers:
        for child in parts_of(slot.armature) if slot.armature is not None else ():
            if child.hide_select:  # it is not being edited
                child.hide_viewport = display in ("OUTLINE", "NONE")
                child.display_type = "SOLID" if display == "SOLID" else "WIRE"
                child.color = (1.0, 1.0, 1.0, 1.0)


def parts_of(armature: bpy.types.Object) -> list[bpy.types.Object]:
    """All meshes that an armature's bones carry; of a skinned character those alone that were made of its skin."""
    carried = [c for c in armature.children if c.type == "MESH" and c.parent_type == "BONE"]
    return [child for child in carried if OF_SKIN in child] or carried


def is_of_skin(armature: bpy.types.Object) -> bool:
    """Whether an armature is a character whose parts were made of its skin."""
    return any(OF_SKIN in child for child in armature.children)


def orphans(scene: bpy.types.Scene) -> list[bpy.types.Object]:
    """Parts in a scene whose armature was deleted, which still have it as parent and cannot be selected."""
    meshes = [o for o in scene.objects if o.type == "MESH" and o.hide_select]
    return [mesh for mesh in meshes if mesh.parent is None and mesh.parent_bone]


def meshes_on(armature: bpy.types.Object, bone: str) -> list[bpy.types.Object]:
    """Return the meshes that a bone carries."""
    return meshes_by_bone(armature).get(bone, [])


def meshes_by_bone(armature: bpy.types.Object) -> dict[str, list[bpy.types.Object]]:
    """Return the meshes that each bone carries, by its name.

    Cheaper than `meshes_on` for bone after bone: Blender looks for an object's children among all objects of the file.
    """
    found: dict[str, list[bpy.types.Object]] = {}
    for child in parts_of(armature):
        found.setdefault(child.parent_bone, []).append(child)
    return found


def _to_bone_tail(child: bpy.types.Object) -> Array:
    """Return the matrix (4, 4) from an object to the tail of the bone it hangs on, or to the object it hangs on."""
    return np.array(child.matrix_parent_inverse) @ np.array(child.matrix_basis)


def part_clouds(armature: bpy.types.Object) -> dict[str, Array]:
    """Return the vertices of the meshes on every bone that carries some, by its name, in the part's frame, shape (V,
    3), in the armature's unit.
    """
    bones = armature.data.bones
    return {
        name: mesh_vertices(armature, bones[name], m) for name, m in meshes_by_bone(armature).items() if name in bones
    }


def mesh_vertices(armature: bpy.types.Object, bone: bpy.types.Bone, meshes: Sequence[bpy.types.Object]) -> Array:
    """Return the vertices of all meshes on a bone, in the part's frame, the armature's unit, shape (V, 3)."""
    clouds = []
    for child in meshes:
        if child.mode == "EDIT":
            child.update_from_editmode()
        local = _to_bone_tail(child)
        clouds.append(_vertices(child.data) @ local[:3, :3].T + local[:3, 3] + [0.0, bone.length, 0.0])
    if not clouds:
        raise BodyError(
            "the bone carries no mesh",
            where=f"armature {armature.name}, bone {bone.name}",
            todo="parent one to it",
        )
    return np.concatenate(clouds)


def shows_more(mesh: bpy.types.Object) -> bool:
    """Whether more is shown of a mesh on a bone than its vertices: by modifiers, or by meshes that hang on it."""
    return _is_modified(mesh) or len(_hanging(mesh)) > 1


def shown_clouds(armature: bpy.types.Object) -> dict[str, Array]:
    """Return the same as `part_clouds` with modifiers, and with the meshes that hang on those of a bone."""
    graph, bones, found = bpy.context.evaluated_depsgraph_get(), armature.data.bones, {}
    for name, meshes in meshes_by_bone(armature).items():
        if name not in bones:  # it was renamed or deleted
            continue
        clouds = [
            _shown_vertices(mesh, graph) @ to_tail[:3, :3].T + to_tail[:3, 3] + [0.0, bones[name].length, 0.0]
            for child in meshes
            for mesh, to_tail in _hanging(child)
        ]
        found[name] = np.concatenate(clouds)
    return found


def _is_modified(mesh: bpy.types.Object) -> bool:
    modifiers = [modifier for modifier in mesh.modifiers if modifier.show_viewport]
    return bool(modifiers) and all(modifier.type != "ARMATURE" for modifier in modifiers)


def _hanging(child: bpy.types.Object) -> list[tuple[bpy.types.Object, Array]]:
    """Return a mesh on a bone and the meshes in sight that hang on it, directly or by empties, with the matrices (4, 4)
    from them to the bone's tail.
    """
    found, open_ends = [], [(child, _to_bone_tail(child))]
    while open_ends:
        thing, to_tail = open_ends.pop()
        if thing == child or (thing.type == "MESH" and thing.visible_get()):
            found.append((thing, to_tail))
        hung = [c for c in thing.children if c.parent_type == "OBJECT" and c.type in ("MESH", "EMPTY")]
        open_ends += [(c, to_tail @ _to_bone_tail(c)) for c in hung]
    return found


def _shown_vertices(mesh: bpy.types.Object, graph: bpy.types.Depsgraph) -> Array:
    """Return the vertices (V, 3) of a mesh, with those of its modifiers, in its own axes."""
    if not _is_modified(mesh):
        return _vertices(mesh.data)
    shown = mesh.evaluated_get(graph)
    points = _vertices(shown.to_mesh())
    shown.to_mesh_clear()
    return points


def _vertices(mesh: bpy.types.Mesh) -> Array:
    points = np.empty(3 * len(mesh.vertices), np.float32)
    mesh.vertices.foreach_get("co", points)
    return points.reshape(-1, 3).astype(float)
