"""An armature at rest: its bones there, and posing it for a moment without its animation."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager

import bpy
import numpy as np
from mathutils import Matrix, Quaternion, Vector

from ....core.body.skeleton_motion import RestSkeleton
from ....core.numerics import rotations
from ....core.numerics.arrays import Array
from ...scene_io import fcurves
from ...scene_io.body.body_armature import world_frame


def rest_skeleton(armature: bpy.types.Object) -> RestSkeleton:
    """Return all bones of an armature at rest, in the world."""
    matrix, _ = world_frame(armature)
    bones = armature.data.bones
    index = {bone.name: i for i, bone in enumerate(bones)}
    heads, tails = (
        np.array(points).reshape(-1, 3) @ matrix[:3, :3].T + matrix[:3, 3]
        for points in ([bone.head_local for bone in bones], [bone.tail_local for bone in bones])
    )
    order = sorted(range(len(bones)), key=lambda i: len(bones[i].parent_recursive))
    place = {i: k for k, i in enumerate(order)}
    return RestSkeleton(
        tuple(bones[i].name for i in order),
        tuple(place[index[bones[i].parent.name]] if bones[i].parent else -1 for i in order),
        heads[order],
        tails[order],
    )


def rest_orientations(armature: bpy.types.Object, names: Sequence[str]) -> Array:
    """Orientations (B, 3, 3) of bones at rest, in the world."""
    matrix, scale = world_frame(armature)
    local = np.array([armature.data.bones[name].matrix_local for name in names]).reshape(-1, 4, 4)
    return rotations.orthonormal(matrix[:3, :3] / scale @ local[:, :3, :3])


@contextmanager
def at_rest(armature: bpy.types.Object, controls: Sequence[str]) -> Iterator[None]:
    """Take an armature's animation away and its controls to their rest pose while the block runs. The sizes of bones
    stay: by them animators scale a whole character, or its head.
    """
    data = fcurves.own_animation(armature) if armature.animation_data else None
    before = (data.action, data.action_slot, data.use_nla) if data else None
    poses = {name: _channels(armature.pose.bones[name]) for name in controls}
    update()
    with evaluated(armature):
        if data:
            data.action, data.use_nla = None, False
        try:
            for name in controls:
                pose(armature.pose.bones[name])
            update()
            yield
        finally:
            for name, values in poses.items():
                for attribute, value in values.items():
                    setattr(armature.pose.bones[name], attribute, value)
            if data:
                data.action, data.use_nla = before[0], before[2]
                if before[1] is not None:
                    data.action_slot = before[1]
    update()


@contextmanager
def evaluated(armature: bpy.types.Object) -> Iterator[None]:
    """Have Blender evaluate an armature's poses while the block runs: it does not in excluded collections, nor when it
    is hidden, or shown in its rest position. Skins are hidden, so that they are not deformed for every pose; those
    that something depends on are evaluated all the same.
    """
    shown = (o for o in bpy.context.view_layer.objects if o.library is None and not o.hide_viewport)
    skins = [o for o in shown if o.type == "MESH" and o.modifiers]
    hidden, position = armature.hide_viewport, armature.data.pose_position
    home = bpy.context.scene.collection.objects
    away = armature.name not in bpy.context.view_layer.objects
    if away:
        home.link(armature)
    armature.hide_viewport, armature.data.pose_position = False, "POSE"
    for skin in skins:
        skin.hide_viewport = True
    try:
        yield
    finally:
        armature.hide_viewport, armature.data.pose_position = hidden, position
        for skin in skins:
            skin.hide_viewport = False
        if away:
            home.unlink(armature)


def leave_rest_position(armature: bpy.types.Object) -> tuple[str, ...]:
    """Have an armature show its poses; returns what to report where it has shown its rest position."""
    if armature.data.pose_position == "POSE":
        return ()
    armature.data.pose_position = "POSE"
    return (f"armature {armature.name}: it was shown in its rest position, and shows its poses now",)


def pose(bone: bpy.types.PoseBone, way: Sequence[float] = (0.0, 0.0, 0.0), turn: Quaternion | None = None) -> None:
    """Shift a bone from its rest pose, and turn it; it keeps its size."""
    bone.matrix_basis = Matrix.LocRotScale(Vector(way), turn, bone.scale)


def _channels(bone: bpy.types.PoseBone) -> dict[str, tuple[float, ...]]:
    """All that poses a bone, to the last bit: its matrix would come back rounded."""
    names = ("location", "rotation_quaternion", "rotation_euler", "rotation_axis_angle", "scale")
    return {name: tuple(getattr(bone, name)) for name in names}


def update() -> None:
    """Let Blender carry constraints and drivers through."""
    bpy.context.view_layer.update()


def posed_matrices(armature: bpy.types.Object, names: Sequence[str]) -> Array:
    """Return the matrices (B, 4, 4) of bones as they are posed now, in the armature: those at rest within `at_rest`."""
    return np.array([armature.pose.bones[name].matrix for name in names]).reshape(-1, 4, 4)


def shown_size(armature: bpy.types.Object, names: Sequence[str]) -> float:
    """Return the mean size of bones by their own scale and that of all above, 1 without any."""
    sizes = [np.cbrt(abs(np.linalg.det(matrix[:3, :3]))) for matrix in posed_matrices(armature, names)]
    return float(np.mean(sizes)) if sizes else 1.0
