"""Simplify: removing tracked keys that are not needed."""

import bpy

from ...properties.tolerance_fields import shift_tolerance, turn_tolerance
from ...scene_io import active_performer
from ..conditions import Conditional, has_performer, has_tracked
from ..key_conditions import has_tracked_keys
from ..reporting import NothingToDoError


class Simplify(Conditional, bpy.types.Operator):
    """Remove tracked keys that smooth curves through the others make unnecessary, for the bones selected in Pose Mode
    or otherwise the whole body. Your own keys stay. Tracking again puts keys on every frame"""

    bl_idname = "kfmocap.simplify"
    bl_label = "Simplify"
    conditions = (has_performer, has_tracked, has_tracked_keys)

    angle: turn_tolerance(1.0, "How far a bone may turn away from what it was, on any frame, degrees")
    distance: shift_tolerance(2.0, "How far the root may move away from where it was, on any frame, mm")

    def act(self, context: bpy.types.Context) -> None:
        from ...editing import simplification

        before = after = 0
        for armature, bones in active_performer.posed_bones(context):
            counts = simplification.simplify(armature, self.angle, self.distance / 1000, bones)
            before, after = before + counts[0], after + counts[1]
        if not before:
            raise NothingToDoError("There are no tracked keys to simplify: track first")
        self.report({"INFO"}, f"{after} of {before} keys are left")


CLASSES = (Simplify,)
