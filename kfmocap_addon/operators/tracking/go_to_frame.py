"""Go to Frame: jump to a key pose, or to a frame on which one would help."""

import bpy

from ...scene_io import active_performer
from ..conditions import Conditional, has_performer
from ..key_conditions import has_other_key_pose
from ..reporting import reported

UNDO_GROUP = "Frame Change"
"""As of Blender's own tools: undoing what was done on a frame does not go back to the frame before it."""


class GoToFrame(bpy.types.Operator):
    """Jump to a frame"""

    bl_idname = "kfmocap.go_to_frame"
    bl_label = "Go to Frame"
    bl_options = {"INTERNAL", "UNDO_GROUPED"}
    bl_undo_group = UNDO_GROUP

    frame: bpy.props.IntProperty(name="Frame", description="Scene frame to go to")
    reason: bpy.props.StringProperty(name="Reason", description="What there is to do at that frame")

    @classmethod
    def description(cls, _context: bpy.types.Context, properties: bpy.types.OperatorProperties) -> str:
        return properties.reason or cls.__doc__

    def execute(self, context: bpy.types.Context) -> set[str]:
        context.scene.frame_set(self.frame)
        return {"FINISHED"}


class StepKeyPose(Conditional, bpy.types.Operator):
    """Jump to the next key pose of the chosen performer, or to the one before; proposals count"""

    bl_idname = "kfmocap.step_key_pose"
    bl_label = "Previous or Next Key Pose"
    bl_options = {"INTERNAL", "UNDO_GROUPED"}
    bl_undo_group = UNDO_GROUP
    conditions = (has_performer, has_other_key_pose)
    while_placing = True

    backward: bpy.props.BoolProperty(name="Backward", description="To the one before this frame")

    def execute(self, context: bpy.types.Context) -> set[str]:
        from ...scene_io.keys import key_pose_curves

        now = context.scene.frame_current
        with reported(self) as outcome:
            keyed, proposed = key_pose_curves.keyed_bones(active_performer.chosen(context).armature)
            beyond = [frame for frame in (*keyed, *proposed) if (frame < now if self.backward else frame > now)]
            if not beyond:
                self.report({"INFO"}, f"There is no key pose {'before' if self.backward else 'after'} frame {now}")
                return {"CANCELLED"}
            context.scene.frame_set(max(beyond) if self.backward else min(beyond))
        return outcome.value


def _has_suggestion(context: bpy.types.Context) -> str:
    slot = active_performer.chosen(context)
    suggested = slot is not None and (slot.helpful or slot.suggestions)
    return "" if suggested else "No key pose is suggested: track first, or all is well"


class NextSuggestion(Conditional, bpy.types.Operator):
    """Jump to the next frame on which one more key pose of the chosen performer would help; after the last, to the
    first"""

    bl_idname = "kfmocap.next_suggestion"
    bl_label = "Next Suggestion"
    bl_options = {"INTERNAL", "UNDO_GROUPED"}
    bl_undo_group = UNDO_GROUP
    conditions = (has_performer, _has_suggestion)
    while_placing = True

    def execute(self, context: bpy.types.Context) -> set[str]:
        slot = active_performer.chosen(context)
        frames = sorted({item.frame for items in (slot.helpful, slot.suggestions) for item in items})
        if not frames:
            self.report({"INFO"}, f"No key pose of {slot.name} is suggested: track first, or all is well")
            return {"CANCELLED"}
        now = context.scene.frame_current
        context.scene.frame_set(next((frame for frame in frames if frame > now), frames[0]))
        return {"FINISHED"}


CLASSES = (GoToFrame, StepKeyPose, NextSuggestion)
