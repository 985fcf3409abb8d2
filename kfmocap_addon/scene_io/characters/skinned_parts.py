"""Making the parts of a body from a skinned character: for each bone, a convex solid around the skin that it moves."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any

import bpy
import numpy as np
from scipy.spatial import ConvexHull, QhullError

from ....core.body import Part
from ....core.errors import BodyError, listed
from ....core.numerics.arrays import Array
from ..body import part_meshes
from .merged_clouds import merged_clouds, says_simulated, says_twist, with_taken_in
from .skins import Skin, read_skin

_CORNERS = 24
"""Directions in which a part's solid touches the skin: few faces, drawn many times."""
_MIN_SIZE_SHARE = 0.045
"""Size of parts, as a share of the skin's height, below which they (fingers, eyes) belong to the part above."""
_MIN_VERTICES = 8
_NAMED = 3
_MOST_VERTICES = 1000
"""Of a part that is drawn as it is: every triangle of its hull is, in every picture and every iteration."""


@dataclass(frozen=True)
class SkinnedParts:
    """The bones that carry a part made from a skin, and remarks on the bones and meshes that could not be used."""

    parts: tuple[str, ...]
    remarks: tuple[str, ...] = field(default_factory=tuple)


def add_parts(
    armature: bpy.types.Object,
    collection: bpy.types.Collection,
    carriers: Mapping[str, str] | None = None,
    following: Mapping[str, str] = MappingProxyType({}),
    *,
    limbs: Collection[str],
    taken_in: Mapping[str, str] = MappingProxyType({}),
    carried: Mapping[str, str] = MappingProxyType({}),
    head: str = "",
) -> SkinnedParts:
    """Add the parts of a body to the bones of a skinned character, as separate meshes.

    Parameters
    ----------
    armature : bpy.types.Object
        Its skin: every mesh that an armature modifier binds to it, or else those that its bones carry.
    collection : bpy.types.Collection
        Where the meshes go.
    carriers : mapping of str to str, optional
        The bone that is posed, by the deforming bone that follows it; by default each deforming bone is posed itself.
    following : mapping of str to str, optional
        What else than its own pose moves a bone, by the bone. Its skin belongs to the part above, unless another part
        hangs on it.
    limbs : collection of str
        Bones that are parts of their own, however small they are.
    taken_in : mapping of str to str
        The bone whose part has the skin of another one, however large that is.
    carried : mapping of str to str
        The same for what the body carries along, such as skirts; skin that is far off is left out.
    head : str
        The bone of the head, if there is one; it takes in no skin that is far off, such as hair.

    Raises
    ------
    BodyError
        Nothing is bound to the armature by weights, or no bone leads enough of the skin.
    """
    where = f"armature {armature.name}"
    remarks = [
        f"mesh {o.name}: bone envelopes are left out, weight it by vertex groups"
        for o in bpy.data.objects
        for m in list[Any](o.modifiers)
        if m.type == "ARMATURE" and m.object == armature and not m.use_vertex_groups
    ]
    skin = _skin(armature)
    if not len(skin.points):
        todo = "; ".join(remarks) or "parent meshes to its bones, or bind one to it by vertex groups"
        raise BodyError("no bone carries a mesh, and no skin is bound to it", where=where, todo=todo)
    clouds, height = _clouds(armature, skin, carriers), float(np.ptp(skin.points, axis=0).max())
    remarks += _carried_remark(clouds, carried, 2 * _MIN_SIZE_SHARE * height)
    loose = {*carried, *(name for name, above in taken_in.items() if above == head)}
    clouds = with_taken_in(armature, clouds, {**carried, **taken_in}, loose, limbs)
    merged, left_out = merged_clouds(armature, clouds, _MIN_SIZE_SHARE * height, following, limbs)
    remarks += [f"bone {n}: it is moved by {following[n]}, so it is left out, and follows the body" for n in left_out]
    kept = {name: cloud for name, cloud in merged.items() if _is_solid(cloud)}
    if not kept:
        raise BodyError("no bone leads enough of the skin to be a part", where=where, todo="paint its weights")
    kept = _with_joined_tops(armature, kept, _MIN_SIZE_SHARE * height)
    if len(tops := _tops(armature, kept)) > 1:
        kept = _one_tree(armature, kept, tops, remarks)
    made = [part_meshes.build_mesh(_part(armature, n, corners(c)), armature, collection) for n, c in kept.items()]
    for mesh in made:
        mesh[part_meshes.OF_SKIN] = True
    return SkinnedParts(tuple(kept), tuple(remarks))


def _carried_remark(clouds: Mapping[str, Array], carried: Mapping[str, str], small: float) -> list[str]:
    """Return a remark on the bones that go along with others, if those on one bone lead skin that is larger than
    `small`, metres, and their names do not say what they are.
    """
    names = [name for name in clouds if name in carried and not (says_twist(name) or says_simulated(name))]
    led = {above: [clouds[name] for name in names if carried[name] == above] for above in carried.values()}
    sizes = {above: np.linalg.norm(np.ptp(np.concatenate(each), axis=0)) for above, each in led.items() if each}
    names = [name for name in names if sizes[carried[name]] > small]
    if not names:
        return []
    what, go = ("bones", "they go") if len(names) > 1 else ("bone", "it goes")
    todo = "to have one tracked, undo, turn it in two key poses, and use the armature again"
    return [f"{what} {listed(names, _NAMED)}: no limb, trunk or head, so {go} along with the body: {todo}"]


def _skin(armature: bpy.types.Object) -> Skin:
    """Return the skin of an armature; where nothing is bound to it, what its bones carry, as of a robot."""
    skin = read_skin(armature)
    carried = {} if len(skin.points) else _carried(armature)
    if not carried:
        return skin
    leaders = np.repeat(np.arange(len(carried)), [len(points) for points in carried.values()])
    return Skin(np.concatenate([*carried.values()]), leaders, list(carried))


def leading_bones(armature: bpy.types.Object) -> list[str]:
    """Bones that lead enough of the skin to be a solid, the others being of no use for a body."""
    skin = _skin(armature)
    return [name for number, name in enumerate(skin.names) if int((skin.leaders == number).sum()) >= _MIN_VERTICES]


def _clouds(armature: bpy.types.Object, skin: Skin, carriers: Mapping[str, str] | None) -> dict[str, Array]:
    """Return the points (V, 3) by the bone that is posed to move them, in the armature's axes: of the skin, and of
    eyes, hats and props that hang on single bones.
    """
    found: dict[str, list[Array]] = {}
    led = {name: skin.points[skin.leaders == number] for number, name in enumerate(skin.names)}
    for name, points in (*led.items(), *_carried(armature).items()):  # a robot's are in both
        carrier = name if carriers is None else carriers.get(name, "")
        if len(points) and carrier:
            found.setdefault(carrier, []).append(points)
    return {name: np.concatenate(clouds) for name, clouds in found.items()}


def _carried(armature: bpy.types.Object) -> dict[str, Array]:
    """Return the vertices (V, 3) of the meshes on every bone that carries some, and of what hangs on these, as they are
    shown, in the armature's axes.
    """
    clouds = part_meshes.shown_clouds(armature)
    frames = {name: np.array(armature.data.bones[name].matrix_local) for name in clouds}
    return {name: clouds[name] @ frame[:3, :3].T + frame[:3, 3] for name, frame in frames.items()}


def carries_its_parts(armature: bpy.types.Object) -> bool:
    """Whether meshes on an armature's bones are the body: there is no skin, or most of it is led by bones with one.

    Otherwise they are eyes, a hat or a prop of a skinned character; or, on an only bone, make one part with its skin;
    or the meshes alone are not what is shown, or too many vertices to be drawn again and again.
    """
    meshes = part_meshes.meshes_by_bone(armature)
    if not meshes or any(child.hide_select for child in part_meshes.parts_of(armature)):
        return bool(meshes)
    skin = read_skin(armature)
    led = skin.leaders[skin.leaders >= 0]
    if not len(led):
        return all(len(cloud) <= _MOST_VERTICES for cloud in part_meshes.part_clouds(armature).values()) and not any(
            part_meshes.shows_more(mesh) for carried in meshes.values() for mesh in carried
        )
    if len(armature.data.bones) == 1:
        return False
    return float(np.isin(led, [i for i, name in enumerate(skin.names) if name in meshes]).mean()) > 0.5


def _is_solid(cloud: Array) -> bool:
    if len(cloud) < _MIN_VERTICES:
        return False
    try:
        ConvexHull(cloud)
    except (QhullError, ValueError):
        return False
    return True


def _tops(armature: bpy.types.Object, kept: Mapping[str, Array]) -> list[str]:
    """Bones of parts that hang on no other part."""
    return [name for name in kept if not any(p.name in kept for p in armature.data.bones[name].parent_recursive)]


def _with_joined_tops(armature: bpy.types.Object, kept: Mapping[str, Array], size: float) -> dict[str, Array]:
    """Hips and spine may hang side by side on a bone that leads no skin: it gets a small part inside the body."""
    tops = _tops(armature, kept)
    chains = [[p.name for p in armature.data.bones[top].parent_recursive] for top in tops]
    shared = [name for name in chains[0] if sum(name in chain for chain in chains) > 1] if len(tops) > 1 else []
    if not shared:
        return dict(kept)
    hung = [np.array(armature.data.bones[t].head_local) for t, c in zip(tops, chains, strict=True) if shared[0] in c]
    ways = np.array(np.meshgrid([-1, 1], [-1, 1], [-1, 1]), float).reshape(3, -1).T
    return _with_joined_tops(armature, {shared[0]: np.mean(hung, axis=0) + 0.25 * size * ways, **kept}, size)


def _one_tree(
    armature: bpy.types.Object, kept: Mapping[str, Array], tops: list[str], remarks: list[str]
) -> dict[str, Array]:
    """Return the largest tree of parts; the bones of the others are named."""

    def below(top: str) -> list[str]:
        chain = {name: [p.name for p in armature.data.bones[name].parent_recursive] for name in kept}
        return [name for name in kept if name == top or top in chain[name]]

    best = max(tops, key=lambda top: sum(len(kept[name]) for name in below(top)))
    for top in tops:
        if top != best:
            todo = "give it a parent there in edit mode (Ctrl P)"
            remarks.append(f"bone {top}: left out, it does not hang on {best} with the rest of the body: {todo}")
    return {name: kept[name] for name in below(best)}


def corners(cloud: Array) -> Array:
    """Corners of a convex solid with few faces around points (V, 3), and with the volume of their convex hull.

    They are those that reach farthest in directions all round, which are spread evenly over the sphere (a Fibonacci
    lattice) in the cloud's own proportions.
    """
    k = np.arange(_CORNERS) + 0.5
    z, angle = 1 - 2 * k / _CORNERS, np.pi * (1 + 5**0.5) * k
    ways = np.stack([np.sqrt(1 - z**2) * np.cos(angle), np.sqrt(1 - z**2) * np.sin(angle), z], axis=1)
    middle = cloud.mean(axis=0)
    _, size, axes = np.linalg.svd(cloud - middle, full_matrices=False)
    scaled = (cloud - middle) @ axes.T / np.maximum(size, 1e-9 * size[0])
    chosen = np.unique((scaled @ ways.T).argmax(axis=0))
    whole = ConvexHull(cloud)
    points = cloud[chosen]
    if not _is_solid(points):
        return np.asarray(cloud[whole.vertices])
    solid = ConvexHull(points)
    # Between its corners the solid lies inside the skin: grown to the skin's volume, its outline is that on average.
    points = points[solid.vertices]
    centre = points.mean(axis=0)
    return np.asarray(centre + np.cbrt(whole.volume / solid.volume) * (points - centre))


def _part(armature: bpy.types.Object, name: str, points: Array) -> Part:
    """Return a part whose corners (V, 3) are in the armature's axes, in those of its bone."""
    bone = armature.data.bones[name]
    frame = np.array(bone.matrix_local)
    inverse = np.linalg.inv(frame)
    vertices = points @ inverse[:3, :3].T + inverse[:3, 3]
    head, tail = np.array(bone.head_local), np.array(bone.tail_local)
    return Part(name, -1, head, tail, frame[:3, :3], vertices)
