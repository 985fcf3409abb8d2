"""The base of tools that make key poses from other poses."""

from __future__ import annotations

from typing import TYPE_CHECKING

import bpy

from ...scene_io import active_performer
from ..conditions import Condition, Conditional, has_performer

if TYPE_CHECKING:
    from ....core.body.motion import Motion


class PosingOperator(Conditional):
    """A tool that poses the chosen performer on this frame and keys it: the bones selected in pose mode, else the whole
    body."""

    conditions: tuple[Condition, ...] = (has_performer,)

    def pose(self, context: bpy.types.Context, armature: bpy.types.Object) -> Motion:
        """Return the new pose."""
        raise NotImplementedError

    def act(self, context: bpy.types.Context) -> None:
        from ...editing import pose_editing

        armature = active_performer.chosen(context).armature
        bones = active_performer.chosen_bones(context, armature)
        pose_editing.set_pose(armature, self.pose(context, armature), context.scene.frame_current, bones)
