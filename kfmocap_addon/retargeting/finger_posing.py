"""Posing and keying the finger bones of a character in a hand shape."""

from __future__ import annotations

import bpy

from ...core.retargeting.hands.hand_shapes import finger_turns
from .rigs.rig_at_rest import rest_orientations, rest_skeleton
from .rigs.rig_curves import rotation_channel
from .target_armatures import target_bones


def key_shape(armature: bpy.types.Object, sides: str, shape: str, amount: float, frame: int) -> None:
    """Pose the fingers of the hands of some sides, "L", "R" or "LR", and key their rotations on a frame, in the
    rotation mode that each bone has.

    Raises
    ------
    BodyError
        The armature is not human, or its fingers are unknown.
    """
    skeleton, bones = rest_skeleton(armature), target_bones(armature)
    hands = [finger_turns(skeleton, bones, side, shape, amount) for side in sides]
    turns = {name: turn for hand in hands for name, turn in hand.items()}
    names = list(turns)
    for name, R in zip(names, rest_orientations(armature, names), strict=True):
        bone = armature.pose.bones[name]
        channel = rotation_channel(bone, (R.T @ turns[name] @ R)[None])
        setattr(bone, channel.attribute, channel.values[0])
        bone.keyframe_insert(channel.attribute, frame=frame, group=name)
