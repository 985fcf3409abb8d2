"""Reading the motion of a tracked performer, or of any other armature, for retargeting."""

from __future__ import annotations

import bpy
import numpy as np

from ...core.body import Body
from ...core.body.skeleton_motion import RestSkeleton, SkeletonMotion, motion_of_body
from ...core.errors import ShotError
from ...core.retargeting.bone_matching import preset_of
from ...core.retargeting.roles import BoneMap
from ..scene_io import fcurves
from ..scene_io.body import body_armature
from ..scene_io.keys import motion_curves
from ..scene_io.scene import frame_rate
from .rig_motion import shown_bone
from .rigs.rig_at_rest import rest_orientations, rest_skeleton
from .rigs.rig_error import world_matrices
from .target_armatures import target_bones


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
    now = scene.frame_current
    for f in range(len(turns)):
        scene.frame_set(first + f)
        R, T = world_matrices(armature, shown)
        turns[f] = R @ np.swapaxes(R_rest, -1, -2)
        places[f] = T + np.einsum("bij,bj->bi", turns[f], whole.heads[own] - whole.heads[others])
    scene.frame_set(now)
    rest = RestSkeleton(tuple(names), (-1,) * len(names), whole.heads[own], whole.tails[own])
    return SkeletonMotion(armature.name, rest, turns, places, frame_rate(scene)), bones
