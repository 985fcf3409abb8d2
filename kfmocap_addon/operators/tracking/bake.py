"""Bake: tracked keys become the animator's own."""

import bpy

from ...scene_io import active_performer
from ..conditions import Conditional, has_performer, has_tracked
from ..key_conditions import has_tracked_keys
from ..reporting import NothingToDoError


class Bake(Conditional, bpy.types.Operator):
    """Turn tracked keys into your own, for the bones selected in Pose Mode or otherwise the whole body: tracking no
    longer replaces them"""

    bl_idname = "kfmocap.bake"
    bl_label = "Bake"
    conditions = (has_performer, has_tracked, has_tracked_keys)

    def act(self, context: bpy.types.Context) -> None:
        from ...scene_io.keys import motion_curves

        posed = active_performer.posed_bones(context)
        frames = max(motion_curves.bake(armature, bones) for armature, bones in posed)
        if not frames:
            raise NothingToDoError("There are no tracked keys to bake: track first")
        self.report({"INFO"}, f"Baked {frames} frames")


CLASSES = (Bake,)
