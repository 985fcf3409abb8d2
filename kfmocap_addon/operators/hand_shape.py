"""Fingers of a character: posed in one of a few shapes, or moved as detectors see the performer's."""

from __future__ import annotations

import bpy

from ..scene_io import active_performer
from .conditions import Conditional, has_footage, has_keypoints, has_performer, has_shot
from .reporting import reported


def has_hands(context: bpy.types.Context) -> str:
    """An armature is active, or a character is chosen."""
    return "" if _character(context) is not None else "Choose the character's armature first"


class HandShape(Conditional, bpy.types.Operator):
    """Pose the fingers of the active armature, or else of the chosen character, and key them on this frame"""

    bl_idname = "kfmocap.hand_shape"
    bl_label = "Hand Shape"
    conditions = (has_hands,)

    shape: bpy.props.EnumProperty(
        items=[
            ("relaxed", "Relaxed", "Slightly bent, as of a hand that does nothing"),
            ("flat", "Flat", "As in the rest pose"),
            ("grip", "Grip", "Around a handle"),
            ("fist", "Fist", "Closed"),
            ("point", "Point", "The index finger stretched, the others closed"),
        ],
        name="Shape",
        description="Shape that the hand takes",
    )
    side: bpy.props.EnumProperty(
        items=[("LR", "Both", ""), ("L", "Left", ""), ("R", "Right", "")], name="Hand", description="Which hand"
    )
    amount: bpy.props.FloatProperty(
        default=1.0, min=0.0, max=1.5, subtype="FACTOR", name="Amount", description="How much of the shape"
    )

    def execute(self, context: bpy.types.Context) -> set[str]:
        from ..retargeting import finger_posing

        with reported(self) as outcome:
            armature = _character(context)
            for side in self.side:
                finger_posing.key_shape(armature, side, self.shape, self.amount, context.scene.frame_current)
        return outcome.value


def _character(context: bpy.types.Context) -> bpy.types.Object | None:
    active = context.view_layer.objects.active if context.view_layer is not None else None
    if active is not None and active.type == "ARMATURE":
        return active
    return context.scene.kfmocap.retarget.target


class FingersFromKeypoints(Conditional, bpy.types.Operator):
    """Move the fingers of a character as the keypoints show the chosen performer's: of OpenPose, COCO-WholeBody or
    MediaPipe Holistic, with hands, in two views or more. The character is the active armature, or else the one chosen
    here, or the performer's own body, which gets fingers. Track first; your own keys of the fingers stay"""

    bl_idname = "kfmocap.fingers_from_keypoints"
    bl_label = "Fingers from Keypoints"
    conditions = (has_shot, has_footage, has_performer, has_keypoints)

    def execute(self, context: bpy.types.Context) -> set[str]:
        from ..retargeting import finger_tracking

        with reported(self) as outcome:
            slot = active_performer.chosen(context)
            active = context.view_layer.objects.active
            hands = finger_tracking.seen_hands(context.scene, slot)
            others = (active, context.scene.kfmocap.retarget.target)
            armature, bones = finger_tracking.with_fingers(slot.armature, others)
            count = finger_tracking.write_fingers(context.scene, armature, bones, hands)
            self.report({"INFO"} if count else {"WARNING"}, f"{count} finger bones of {armature.name} move")
        return outcome.value


CLASSES = (HandShape, FingersFromKeypoints)
