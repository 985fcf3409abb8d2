"""Reading the motion of a tracked performer, or of any other armature, for retargeting."""

from __future__ import annotations

from collections.abc import Sequence

import bpy
import numpy as np

from ...core.body import Body
from ...core.body.skeleton_motion import RestSkeleton, SkeletonMotion, motion_of_body
from ...core.errors import ShotError
from ...core.numerics.arrays import Array
from ...core.retargeting.bone_matching import preset_of
from ...core.retargeting.bone_roles.roles import SIDES, BoneMap, parent_role
from ..scene_io import fcurves
from ..scene_io.body import body_armature
from ..scene_io.keys import motion_curves
from ..scene_io.scene import frame_rate
from ..scene_io.visited_frames import same_time
from .rig_motion import shown_bone
from .rigs.rig_at_rest import posed_matrices, rest_orientations, rest_skeleton
from .rigs.rig_error import world_matrices
from .target_armatures import target_bones

_MIN_CHANGE = 1e-3
"""Least change of a bone's size that rounding cannot explain."""


def motion_of_performer(
    scene: bpy.types.Scene, slot: bpy.types.PropertyGroup, body: Body | None = None
) -> SkeletonMotion:
    """Return the motion in a performer's curves on the frames of the shot. `body` is the performer's, if it has been
    read already.

    Raises
    ------
    ShotError
        The performer has no keys, or the shot no frames.
    """
    where = f"performer {slot.name}"
    if fcurves.find_channelbag(slot.armature) is None:
        raise ShotError("there is no motion yet", where=where, todo="track first")
    properties = scene.kfmocap
    if properties.length < 1:
        raise ShotError("the shot has no frames", where="Frames", todo="put the last frame after the first")
    if body is None:
        body = body_armature.body_from_armature(slot.armature)
    motion = motion_curves.read_motion(slot.armature, properties.frame_start, properties.length)
    return motion_of_body(body, motion, slot.name, frame_rate(scene))


def shown_bones(armature: bpy.types.Object, bones: BoneMap) -> dict[str, str]:
    """Return for each bone of a map the bone that shows its motion."""
    follows = preset_of(bones).follows
    return {name: shown_bone(armature, follows, name) for name in bones.names()}


def motion_of_armature(
    scene: bpy.types.Scene, armature: bpy.types.Object, frames: tuple[int, int], bones: BoneMap | None = None
) -> tuple[SkeletonMotion, BoneMap]:
    """Return the evaluated motion of an armature's bones, and their roles.

    Parameters
    ----------
    scene : bpy.types.Scene
        The one that shows the armature.
    armature : bpy.types.Object
    frames : tuple of int
        First and last scene frame.
    bones : BoneMap, optional
        By default found.

    Raises
    ------
    BodyError
        It is not human.
    ShotError
        There are no frames.
    """
    first, last = frames
    if last < first:
        raise ShotError(f"the last frame ({last}) is before the first ({first})", where="Frames")
    bones = bones or target_bones(armature)
    names = bones.names()
    shown = list(shown_bones(armature, bones).values())
    whole = rest_skeleton(armature)
    own, others = whole.indices(names), whole.indices(shown)
    R_rest = rest_orientations(armature, shown)
    turns = np.empty((last - first + 1, len(names), 3, 3))
    places = np.empty(turns.shape[:3])
    with same_time(scene):
        for f in range(len(turns)):
            scene.frame_set(first + f)
            if f == 0:
                sizes = _sizes(armature, shown)
            R, T = world_matrices(armature, shown)
            turns[f] = R @ np.swapaxes(R_rest, -1, -2)
            places[f] = T + np.einsum("bij,bj->bi", turns[f], whole.heads[own] - whole.heads[others])
    rest = RestSkeleton(tuple(names), (-1,) * len(names), whole.heads[own], whole.tails[own])
    rest = _sized(rest, bones, R_rest, sizes)
    return SkeletonMotion(armature.name, rest, turns, places, frame_rate(scene)), bones


def _sizes(armature: bpy.types.Object, names: Sequence[str]) -> Array:
    """Return by how much bones are larger, along each of their axes, than at rest, shape (B, 3)."""
    return np.linalg.norm(posed_matrices(armature, names)[:, :3, :3], axis=1)


def _sized(rest: RestSkeleton, bones: BoneMap, R_rest: Array, sizes: Array) -> RestSkeleton:
    """Return a skeleton whose bones, in the order of the map, have the sizes that their own scale and that of the bones
    above give them; its feet stand where they stood.
    """
    if np.abs(sizes - 1).max(initial=0.0) < _MIN_CHANGE:
        return rest

    def larger(b: int, way: Array) -> Array:
        return np.asarray(R_rest[b] @ (sizes[b] * (R_rest[b].T @ way)))

    heads, last = rest.heads.copy(), {role: rest.indices(names)[-1] for role, names in bones.bones.items()}
    for role, k, name in bones.items():
        [b] = rest.indices([name])
        above = last.get(parent_role(role, bones.bones)) if k == 0 else b - 1
        if above is not None:
            heads[b] = heads[above] + larger(above, rest.heads[b] - rest.heads[above])
    feet = [last[f"foot.{side}"] for side in SIDES if f"foot.{side}" in last]
    if feet:
        wanted = rest.ground + (rest.heads[feet, 2] - rest.ground) * np.cbrt(sizes[feet].prod(axis=1))
        heads[:, 2] += float(np.mean(wanted - heads[feet, 2]))
    tails = heads + np.array([larger(b, way) for b, way in enumerate(rest.tails - rest.heads)])
    return RestSkeleton(rest.names, rest.parents, heads, tails, rest.ground)
