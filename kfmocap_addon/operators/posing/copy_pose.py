"""Copy, paste and mirror poses, on any frames, in any mode."""

from __future__ import annotations

from typing import TYPE_CHECKING

import bpy

from ...scene_io import active_performer
from ..conditions import Conditional, has_performer, on_whole_frame
from .posing_operator import PosingOperator

if TYPE_CHECKING:
    from ....core.body.motion import Motion

_ROOT = bpy.props.BoolProperty(
    name="Place and Heading",
    description="Mirror where the body is and where it faces as well, across the middle of its rest pose, as "
    "Blender's Paste Pose Flipped does; else these stay",
)


class CopyPose(Conditional, bpy.types.Operator):
    """Copy the pose on this frame, tracked or your own, to paste it on another"""

    bl_idname = "kfmocap.copy_pose"
    bl_label = "Copy Pose"
    conditions = (has_performer,)

    def act(self, context: bpy.types.Context) -> None:
        from ...editing import pose_editing

        context.scene.kfmocap.copied = pose_editing.copied(active_performer.chosen(context).armature)
        self.report({"INFO"}, f"Copied the pose of frame {context.scene.frame_current}")


def _has_copied_pose(context: bpy.types.Context) -> str:
    return "" if context.scene.kfmocap.copied else "Copy a pose first"


class PastePose(PosingOperator, bpy.types.Operator):
    """Make the copied pose a key pose on this frame, for the bones selected in Pose Mode or otherwise the whole body"""

    bl_idname = "kfmocap.paste_pose"
    bl_label = "Paste Pose"
    conditions = (has_performer, on_whole_frame, _has_copied_pose)

    flipped: bpy.props.BoolProperty(name="Mirrored", description="Exchange left and right")
    root: _ROOT

    @classmethod
    def description(cls, _context: bpy.types.Context, properties: bpy.types.OperatorProperties) -> str:
        return cls.__doc__ + (". Left and right are exchanged" if properties.flipped else "")

    def pose(self, context: bpy.types.Context, armature: bpy.types.Object) -> Motion:
        from ...editing import pose_editing

        pasted = pose_editing.pasted(armature, context.scene.kfmocap.copied)
        return pose_editing.mirrored(armature, pasted, self.root) if self.flipped else pasted


class MirrorPose(PosingOperator, bpy.types.Operator):
    """Swap left and right of the pose on this frame and key it, for the bones selected in Pose Mode or otherwise the
    whole body. Bones are paired by name, such as forearm.L and forearm.R"""

    bl_idname = "kfmocap.mirror_pose"
    bl_label = "Mirror Pose"
    conditions = (has_performer, on_whole_frame)

    root: _ROOT

    def pose(self, _context: bpy.types.Context, armature: bpy.types.Object) -> Motion:
        from ...editing import pose_editing
        from ...scene_io.body import shown_pose

        return pose_editing.mirrored(armature, shown_pose.read_shown_pose(armature), self.root)


CLASSES = (CopyPose, PastePose, MirrorPose)
