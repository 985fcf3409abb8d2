"""Moving the fingers of a character by hand keypoints."""

from __future__ import annotations

from collections.abc import Sequence

import bpy
import numpy as np
from mathutils import Vector

from ...core.body.finger_bones import finger_bones
from ...core.errors import BodyError
from ...core.formats.keypoint_files import read_shot_keypoints
from ...core.keypoints.hand_points import hand_points
from ...core.numerics.arrays import Array
from ...core.retargeting.bone_matching import match_bones
from ...core.retargeting.bone_roles.roles import FINGERS, SIDES, BoneMap
from ...core.retargeting.hands.finger_motion import finger_motion
from ..scene_io import fcurves, scene
from ..scene_io.body import body_armature
from .rigs.rig_at_rest import rest_orientations, rest_skeleton
from .rigs.rig_curves import ControlChannel, rotation_channel
from .source_motion import motion_of_performer
from .target_armatures import target_bones


def armature_with_fingers(candidates: Sequence[bpy.types.Object | None]) -> tuple[bpy.types.Object, BoneMap]:
    """Return the first of some armatures that has fingers, and the roles of its bones.

    Raises
    ------
    BodyError
        None has.
    """
    for armature in dict.fromkeys(one for one in candidates if one is not None and one.type == "ARMATURE"):
        try:
            bones = target_bones(armature)
        except BodyError:
            continue
        if any(f"{finger}.{side}" in bones.bones for finger in FINGERS for side in SIDES):
            return armature, bones
    raise BodyError(
        "no armature has fingers that are known",
        where="Send to Rig",
        todo="choose it as Character, or make its armature active",
    )


def seen_hands(current: bpy.types.Scene, slot: bpy.types.PropertyGroup) -> Array:
    """Return the points of a performer's hands from keypoints, world frame, metres, shape (F, 2, 21, 3).

    Raises
    ------
    KFMocapError
        The performer has no motion or no hands, or fewer than two views show them.
    """
    source = motion_of_performer(current, slot)
    roles = match_bones(source.rest, None, f"performer {slot.name}").bones
    if any(f"hand.{side}" not in roles for side in SIDES):
        raise BodyError("the body has no hands", where=f"performer {slot.name}", todo="use a body with hands")
    wrists = source.rest.indices([roles[f"hand.{side}"][0] for side in SIDES])
    shot = scene.shot_from_scene(current)
    return hand_points(shot, read_shot_keypoints(shot, hands=True), source.positions[:, wrists])


def add_fingers(current: bpy.types.Scene, hands: Sequence[Array | None]) -> None:
    """Move the fingers of a scene's performers by points of their hands, where these are given; see `write_fingers`."""
    for slot, points in zip(current.kfmocap.performers, hands, strict=False):
        if points is not None:
            write_fingers(current, *with_fingers(slot.armature), points)


def with_fingers(
    armature: bpy.types.Object, others: Sequence[bpy.types.Object | None] = ()
) -> tuple[bpy.types.Object, BoneMap]:
    """Return the first of some others and a performer's armature that has fingers, and the roles of its bones.

    If none has, finger bones are added to a body made by this add-on.

    Raises
    ------
    BodyError
        None has known fingers, and the performer's is not a body made by this add-on.
    """
    try:
        return armature_with_fingers([*others, armature])
    except BodyError:
        body = body_armature.body_from_armature(armature)
        if {"hand.L", "hand.R"} - set(body.names):
            raise
    to_armature = armature.matrix_world.inverted()
    made = finger_bones(body)
    with body_armature.edit_bones(armature) as bones:
        for each in made:
            bone = bones.new(each.name)
            bone.head, bone.tail = (to_armature @ Vector(p.tolist()) for p in (each.head_world, each.tail_world))
            bone.parent = bones[each.parent]
    for each in made:
        armature.pose.bones[each.name].rotation_mode = "QUATERNION"
        armature.pose.bones[each.name].lock_location = (True,) * 3
    return armature_with_fingers([armature])


def write_fingers(current: bpy.types.Scene, armature: bpy.types.Object, bones: BoneMap, hands: Array) -> int:
    """Key the fingers of an armature on every frame of the shot by points of the performer's hands (F, 2, 21, 3);
    returns how many bones move.
    """
    turns = finger_motion(rest_skeleton(armature), bones, hands, scene.frame_rate(current))
    frames = current.kfmocap.frame_start + np.arange(len(hands))
    for name, R in zip(turns, rest_orientations(armature, list(turns)), strict=True):
        channel = rotation_channel(armature.pose.bones[name], R.T @ turns[name] @ R)
        _write(armature, channel, frames)
    return len(turns)


def _write(armature: bpy.types.Object, channel: ControlChannel, frames: Array) -> None:
    """Replace generated keys on the frames; the animator's own stay."""
    bag = fcurves.ensure_channelbag(armature, armature.name)
    for index, column in enumerate(channel.values.T):
        curve = fcurves.ensure_fcurve(bag, channel.path, index, channel.bone)
        keys = fcurves.get_keys(curve)
        inside = (keys["co"][:, 0] > frames[0] - 0.5) & (keys["co"][:, 0] < frames[-1] + 0.5)
        kept = keys[~inside | (keys["type"] != fcurves.enum_value("type", "GENERATED"))]
        free = ~np.isin(frames, fcurves.frames_of(kept))
        fcurves.set_keys(curve, [kept, fcurves.new_keys(frames[free], column[free], "GENERATED", "LINEAR")])
