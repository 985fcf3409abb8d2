"""Small changes of a pose: towards the neighbouring key poses, and towards or away from the camera."""

from __future__ import annotations

from typing import TYPE_CHECKING

import bpy

from ..conditions import has_performer, on_whole_frame
from ..key_conditions import has_other_key_pose, is_between_key_poses
from .posing_operator import PosingOperator

if TYPE_CHECKING:
    from ....core.body.motion import Motion


class BreakdownPose(PosingOperator, bpy.types.Operator):
    """Make a key pose between the previous and the next key pose, which must both exist, for the bones selected in Pose
    Mode or otherwise the whole body"""

    bl_idname = "kfmocap.breakdown_pose"
    bl_label = "Breakdown"
    conditions = (has_performer, on_whole_frame, is_between_key_poses)

    share: bpy.props.FloatProperty(
        default=0.5,
        soft_min=0.0,
        soft_max=1.0,
        subtype="FACTOR",
        name="Share",
        description="0 is the key pose before this frame, 1 the one after it; beyond them the pose is exaggerated",
    )

    def pose(self, context: bpy.types.Context, armature: bpy.types.Object) -> Motion:
        from ...editing import pose_editing

        return pose_editing.between(armature, context.scene.frame_current, self.share)


class NudgePose(PosingOperator, bpy.types.Operator):
    """Move the pose on this frame a little towards the previous or the next key pose and key it, for the bones selected
    in Pose Mode or otherwise the whole body"""

    bl_idname = "kfmocap.nudge_pose"
    bl_label = "Nudge Pose"
    conditions = (has_performer, on_whole_frame, has_other_key_pose)

    side: bpy.props.EnumProperty(
        items=[
            ("BEFORE", "Before", "Towards the key pose before this frame"),
            ("AFTER", "After", "Towards the key pose after this frame"),
        ],
        name="Towards",
        description="Which key pose",
    )
    share: bpy.props.FloatProperty(
        default=0.1,
        soft_min=-1.0,
        soft_max=1.0,
        subtype="FACTOR",
        name="Share",
        description="Share of the way to that key pose; below 0 away from it",
    )

    def pose(self, context: bpy.types.Context, armature: bpy.types.Object) -> Motion:
        from ...editing import pose_editing

        return pose_editing.nudged(armature, context.scene.frame_current, self.side == "BEFORE", self.share)


def _has_camera(context: bpy.types.Context) -> str:
    return "" if context.scene.camera is not None else "The scene has no camera: look through a view first"


class NudgeDepth(PosingOperator, bpy.types.Operator):
    """Move the body nearer to the camera that the scene looks through, or farther from it, so that it looks the same
    from there, and key it: this corrects the depth, which one camera does not show"""

    bl_idname = "kfmocap.nudge_depth"
    bl_label = "Nudge Depth"
    conditions = (has_performer, on_whole_frame, _has_camera)

    distance: bpy.props.FloatProperty(
        default=0.05,
        soft_min=-1.0,
        soft_max=1.0,
        unit="LENGTH",
        name="Distance",
        description="How much farther from the camera, metres; below 0 nearer",
    )

    def pose(self, context: bpy.types.Context, armature: bpy.types.Object) -> Motion:
        from ...editing import pose_editing

        return pose_editing.nudged_in_depth(context.scene, armature, self.distance)


CLASSES = (BreakdownPose, NudgePose, NudgeDepth)
