"""The motion of a tracked performer, as retargeting reads it."""

from __future__ import annotations

import bpy

from ...core.errors import ShotError
from ...core.retargeting.skeleton_motion import SkeletonMotion, motion_of_body
from ..scene_io import body_armature, fcurves, motion_curves


def motion_of_performer(scene: bpy.types.Scene, slot: bpy.types.PropertyGroup) -> SkeletonMotion:
    """Return what the curves of a performer show on the frames of the shot.

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
    body = body_armature.body_from_armature(slot.armature)
    motion = motion_curves.read_motion(slot.armature, properties.frame_start, properties.length)
    return motion_of_body(body, motion, slot.name, scene.render.fps / scene.render.fps_base)
