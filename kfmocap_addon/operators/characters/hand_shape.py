"""Fingers of a character: posing them in a hand shape, or moving them by the performer's hand keypoints."""

from __future__ import annotations

import bpy

from ....core.choices import HAND_SHAPES
from ...properties.choice_items import choice_items
from ...scene_io import active_performer
from ..conditions import Conditional, has_footage, has_keypoints, has_performer, has_shot


def has_hands(context: bpy.types.Context) -> str:
    """An armature is active, or a character or a performer is chosen."""
    return "" if _character(context) is not None else "Choose a character first, or add a body"


class HandShape(Conditional, bpy.types.Operator):
    """Pose the fingers of the active armature, or else of the character chosen here, or else of the chosen performer's
    body, which gets fingers, and key them on this frame"""

    bl_idname = "kfmocap.hand_shape"
    bl_label = "Hand Shape"
    conditions = (has_hands,)

    shape: bpy.props.EnumProperty(
        items=choice_items(HAND_SHAPES), name="Shape", description="Shape that the hand takes"
    )
    side: bpy.props.EnumProperty(
        items=[("LR", "Both", ""), ("L", "Left", ""), ("R", "Right", "")], name="Hand", description="Which hand"
    )
    amount: bpy.props.FloatProperty(
        default=1.0, min=0.0, max=1.5, subtype="FACTOR", name="Amount", description="How much of the shape"
    )

    def act(self, context: bpy.types.Context) -> None:
        from ...retargeting import finger_posing, finger_tracking

        armature = _character(context)
        frame, slot = context.scene.frame_current, active_performer.chosen(context)
        if slot is not None and armature == slot.armature:
            finger_tracking.with_fingers(armature)
        finger_posing.key_shape(armature, self.side, self.shape, self.amount, frame)
        hands = {"LR": "both hands", "L": "left hand", "R": "right hand"}[self.side]
        self.report({"INFO"}, f"{armature.name}: {hands} keyed on frame {frame}")


def _character(context: bpy.types.Context) -> bpy.types.Object | None:
    active = context.view_layer.objects.active if context.view_layer is not None else None
    if active is not None and active.type == "ARMATURE":
        return active
    slot = active_performer.chosen(context)
    return context.scene.kfmocap.retarget.target or (slot.armature if slot is not None else None)


class FingersFromKeypoints(Conditional, bpy.types.Operator):
    """Move the fingers of a character as the keypoints show the chosen performer's: of OpenPose, COCO-WholeBody or
    MediaPipe Holistic, with hands, in two views or more. The character is the active armature, or else the one chosen
    here, or the performer's own body, which gets fingers. Track first; your own keys of the fingers stay"""

    bl_idname = "kfmocap.fingers_from_keypoints"
    bl_label = "Fingers from Keypoints"
    conditions = (has_shot, has_footage, has_performer, has_keypoints)

    def act(self, context: bpy.types.Context) -> None:
        from ...retargeting import finger_tracking

        slot = active_performer.chosen(context)
        active = context.view_layer.objects.active
        hands = finger_tracking.seen_hands(context.scene, slot)
        others = (active, context.scene.kfmocap.retarget.target)
        armature, bones = finger_tracking.with_fingers(slot.armature, others)
        count = finger_tracking.write_fingers(context.scene, armature, bones, hands)
        self.report({"INFO"} if count else {"WARNING"}, f"{count} finger bones of {armature.name} move")


CLASSES = (HandShape, FingersFromKeypoints)
