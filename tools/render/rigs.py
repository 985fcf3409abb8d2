"""Characters as they are bought, linked or generated: how their rigs are built; needs the bpy module.

They have no names that a preset knows, or those of a kind of rig; none has the proportions of the tracker's body. Their
skins differ from the solids that the tracker sees in them. Meshes have colours (`rig_parts.COLOURS`).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import addon_utils
import bpy
import numpy as np
from kfmocap.core.body import Body, Part, human
from mathutils import Matrix
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from .creatures import resting
from .dressed import body_bones, vroid, vroid_names
from .figure import make_figure
from .rig_parts import bind, coloured_mesh, new_armature
from .shapes import Shape
from .textures import noise

Array = NDArray[np.float64]
Bone = tuple[str, str, Array, Array]
"""Name, parent (empty for none), head and tail in the world, metres."""
RINGS, CORNERS = 14, 24
"""Of the mesh of a rigid part."""
CENTIMETRES = 0.01


def _skinned(armature: bpy.types.Object, radii: Mapping[str, float], voxel: float) -> bpy.types.Object:
    """Give an armature one smooth skin, of these radii around its bones in the world, metres; returns the armature."""
    matrix = np.array(armature.matrix_world)
    parts = []
    for name in radii:
        bone = armature.data.bones[name]
        head, tail = (matrix[:3, :3] @ end + matrix[:3, 3] for end in (bone.head_local, bone.tail_local))
        parts.append(Part(name, min(len(parts), 1) - 1, head, tail, np.eye(3), np.zeros((0, 3))))
    shapes = []
    for part, r in zip(parts, radii.values(), strict=True):
        along = part.tail_world - part.head_world
        deep = (0.0, 0.0, 1.0) if abs(along[2]) < 0.7 * np.linalg.norm(along) else (0.0, 1.0, 0.0)
        stations = ((0.0, r, r, 0.0), (0.5, 1.1 * r, 1.1 * r, 0.0), (1.0, 0.8 * r, 0.8 * r, 0.0))
        shapes.append(Shape(part.name, (0, 0, 0), tuple(along.tolist()), stations, deep))
    body = Body(tuple(parts), {})
    figure = make_figure(body, voxel, shapes, _patchwork, pose=resting(body))
    to_local = np.linalg.inv(matrix)
    points = figure.vertices @ to_local[:3, :3].T + to_local[:3, 3]
    skin = coloured_mesh("skin", points, figure.triangles, figure.colours)
    bind(skin, armature, dict(zip(radii, figure.weights.T, strict=True)))
    return armature


def _patchwork(body: Body, nearest: NDArray[np.int64], local: Array) -> Array:
    """A colour for each part, with grain in proportion to the size of the body."""
    rng = np.random.default_rng(len(body))
    colours = 0.6 * rng.uniform(0.2, 0.8, (len(body), 3)) + np.array([0.35, 0.25, 0.15])
    size = max(float(np.linalg.norm(np.ptp([part.head_world for part in body.parts], axis=0))), 0.1)
    grain = 1 + 0.25 * noise(local / (0.02 * size)) + 0.2 * noise(local / (0.06 * size))
    return np.clip(colours[nearest] * grain[:, None], 0.03, 0.95)


def _animal(kind: str) -> bpy.types.Object:
    """Rigify's rig of an animal as it is generated, its limbs at FK."""
    addon_utils.enable("rigify", default_set=True)
    getattr(bpy.ops.object, f"armature_{kind}_metarig_add")()
    metarig = bpy.context.object
    bpy.ops.object.mode_set(mode="OBJECT")
    bpy.ops.pose.rigify_generate()
    rig = next(owner for owner in bpy.data.objects if owner.type == "ARMATURE" and owner != metarig)
    bpy.data.objects.remove(metarig)
    deforming = [bone for bone in rig.data.bones if bone.name.startswith("DEF-")]
    size = float(np.linalg.norm(np.ptp([end for b in deforming for end in (b.head_local, b.tail_local)], axis=0)))
    voxel = size / 75
    radii = {
        bone.name: max(min(0.3 * bone.length, 0.06 * size), 1.3 * voxel)
        for bone in deforming
        if bone.length > 1.2 * voxel
    }
    _skinned(rig, radii, voxel)
    for bone in rig.pose.bones:
        for key in (key for key in list(bone.keys()) if "IK_FK" in key):
            bone[key] = 1.0
    rig.update_tag()
    bpy.context.view_layer.update()
    return rig


def bird() -> bpy.types.Object:
    """Rigify's bird, 0.6 m."""
    return _animal("bird")


def cat() -> bpy.types.Object:
    """Rigify's cat, 1.0 m."""
    return _animal("cat")


def _chain(prefix: str, above: str, places: Sequence[Sequence[float]]) -> list[Bone]:
    """Bones from place to place: their names are a prefix and numbers from 1."""
    names = [above, *(f"{prefix}{k + 1}" for k in range(len(places) - 1))]
    ends = [np.array(place, float) for place in places]
    return [(names[k + 1], names[k], ends[k], ends[k + 1]) for k in range(len(places) - 1)]


def _mirrored(places: Sequence[Sequence[float]], sign: float) -> list[list[float]]:
    return [[sign * x, y, z] for x, y, z in places]


_DRAGON_RADII: Mapping[str, float] = {"Neck": 0.2, "Skull": 0.22, "wing": 0.11, "fore": 0.13, "hind": 0.16}
_DRAGON_SIZE = 0.42
"""All of the dragon's lengths below are multiplied by it."""


def dragon() -> bpy.types.Object:
    """A dragon of 3.4 m with a tail of eight bones, four legs, and wings."""
    bones = [
        ("Body_Root", "", np.array([0, 0.6, 1.6]), np.array([0, 0, 1.65])),
        *_chain("Body_", "Body_Root", [(0, 0, 1.65), (0, -0.7, 1.65), (0, -1.3, 1.75)]),
        *_chain("Neck_", "Body_2", [(0, -1.3, 1.8), (0, -1.65, 2.15), (0, -1.85, 2.55), (0, -2.05, 2.85)]),
        ("Skull", "Neck_3", np.array([0, -2.05, 2.85]), np.array([0, -2.6, 2.75])),
        *_chain("Tail_", "Body_Root", [(0, 0.65 + 0.42 * i, 1.6 - 0.11 * i) for i in range(9)]),
    ]
    wing = ((0.25, -1.0, 1.95), (0.9, -0.9, 2.5), (1.7, -0.6, 2.5), (2.5, -0.1, 2.3))
    fore = ((0.35, -1.1, 1.5), (0.38, -0.95, 0.85), (0.38, -1.1, 0.2), (0.38, -1.4, 0.06))
    hind = ((0.38, 0.5, 1.5), (0.42, 0.25, 0.85), (0.42, 0.65, 0.3), (0.42, 0.45, 0.05))
    for side, sign in (("l", 1.0), ("r", -1.0)):
        for name, above, limb in (("wing", "Body_2", wing), ("fore", "Body_2", fore), ("hind", "Body_Root", hind)):
            bones += _chain(f"{name}_{side}_", above, _mirrored(limb, sign))
    radii = {}
    for name, *_ in bones:
        kind, _, number = name.partition("_")
        thick = 0.24 - 0.024 * int(number) if kind == "Tail" else 0.36
        radii[name] = _DRAGON_SIZE * _DRAGON_RADII.get(kind, thick)
    scaled = [(name, above, _DRAGON_SIZE * head, _DRAGON_SIZE * tail) for name, above, head, tail in bones]
    return _skinned(new_armature("Dragon", np.eye(4), scaled), radii, 0.02)


_ROBOT_WIDTHS: Mapping[str, float] = {
    "base": 0.2, "torso": 0.2, "dome": 0.16, "piston": 0.06, "claw": 0.06, "strut": 0.07, "pad": 0.06
}  # fmt: skip


def robot() -> bpy.types.Object:
    """A robot of rigid meshes that are parented to bones, in centimetres, the armature scaled by 0.01."""
    bones = [
        ("base", "", np.array([0, 0, 0.45]), np.array([0, 0, 0.6])),
        ("torso", "base", np.array([0, 0, 0.6]), np.array([0, 0, 0.95])),
        ("dome", "torso", np.array([0, 0, 0.95]), np.array([0, 0, 1.2])),
    ]
    arm = ((0.26, 0, 0.9), (0.36, 0, 0.65), (0.36, -0.1, 0.4), (0.36, -0.14, 0.25))
    leg = ((0.14, 0, 0.45), (0.15, -0.03, 0.24), (0.15, 0, 0.05), (0.15, -0.16, 0.03))
    for side, sign in (("Lft", 1.0), ("Rgt", -1.0)):
        for above, limb, names in (("torso", arm, "piston_a piston_b claw"), ("base", leg, "strut_a strut_b pad")):
            called = [above, *(f"{name}_{side}" for name in names.split())]
            chain = _chain("", "", _mirrored(limb, sign))
            bones += [(called[k + 1], called[k], head, tail) for k, (_, _, head, tail) in enumerate(chain)]
    armature = new_armature("Robot", np.diag([CENTIMETRES, CENTIMETRES, CENTIMETRES, 1.0]), bones)
    rng = np.random.default_rng(5)
    for name, _, head, tail in bones:
        vertices, triangles = _solid(head, tail, _ROBOT_WIDTHS[name.split("_")[0]])
        stripes = np.mod((vertices @ [0.7, 0.3, 1.0]) / 0.07, 1) < 0.4
        paint = rng.uniform(0.25, 0.75, 3)
        colours = np.where(stripes[:, None], paint, 0.5 * paint + 0.2) * (1 + 0.1 * rng.normal(size=(len(vertices), 1)))
        part = coloured_mesh(f"part_{name}", vertices, triangles, np.clip(colours, 0.03, 0.95))
        part.parent, part.parent_type, part.parent_bone = armature, "BONE", name
        bpy.context.view_layer.update()
        part.matrix_world = Matrix.Identity(4)
    bpy.context.view_layer.update()
    return armature


def _solid(head: Array, tail: Array, width: float) -> tuple[Array, NDArray[np.int64]]:
    """Vertices and triangles of a bulging box around a bone."""
    along = (tail - head) / np.linalg.norm(tail - head)
    x = np.cross(along, [0, 1, 0.2])
    x /= np.linalg.norm(x)
    turn, share = np.meshgrid(2 * np.pi * np.arange(CORNERS) / CORNERS, np.linspace(0, 1, RINGS))
    square = np.minimum(1 / np.maximum(np.abs(np.cos(turn)), np.abs(np.sin(turn))), 1.25)
    radius = width * (0.8 + 0.2 * np.sin(np.pi * share)) * square
    beside = np.cos(turn)[..., None] * x + np.sin(turn)[..., None] * np.cross(along, x)
    points = head + share[..., None] * (tail - head) + radius[..., None] * beside
    number = np.arange(RINGS * CORNERS).reshape(RINGS, CORNERS)
    a, b = number[:-1], np.roll(number[:-1], -1, axis=1)
    c, d = np.roll(number[1:], -1, axis=1), number[1:]
    first, last = RINGS * CORNERS, RINGS * CORNERS + 1
    ends = [np.stack([np.full(CORNERS, first), b[0], a[0]], -1), np.stack([np.full(CORNERS, last), d[-1], c[-1]], -1)]
    sides = [np.stack([a, b, c], -1).reshape(-1, 3), np.stack([a, c, d], -1).reshape(-1, 3)]
    return np.concatenate([points.reshape(-1, 3), [head, tail]]), np.concatenate([*sides, *ends])


def avatar() -> bpy.types.Object:
    """A human of VRM bones, in centimetres, the armature scaled by 0.01 and lying on its back."""
    body = human(1.64, collar_bones=True)
    names = vroid_names(body.names)
    figure = make_figure(body, 0.012)
    root = ("Root", "", np.zeros(3), np.array([0, 0, 0.2 * CENTIMETRES]))
    bones: list[Bone] = [root, *body_bones(figure, names, "Root")]
    matrix = np.eye(4)
    matrix[:3, :3] = CENTIMETRES * Rotation.from_euler("x", 90, degrees=True).as_matrix()
    armature = new_armature("Avatar", matrix, bones)
    local = figure.vertices @ np.linalg.inv(matrix[:3, :3]).T
    skin = coloured_mesh("Body", local, figure.triangles, figure.colours)
    bind(skin, armature, {names[part]: figure.weights[:, i] for i, part in enumerate(body.names)})
    return armature


RIGS: Mapping[str, Callable[[], bpy.types.Object]] = {
    "bird": bird, "cat": cat, "dragon": dragon, "robot": robot, "avatar": avatar, "vroid": vroid
}  # fmt: skip
"""Build a character in an empty file; return its armature."""
LINKED = ("avatar",)
"""Characters that the file with the motion links from another one, and overrides."""
