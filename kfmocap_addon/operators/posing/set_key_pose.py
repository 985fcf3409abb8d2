"""Set Key Pose: keying the present pose, which the tracker must then meet; and removing such keys."""

import bpy

from ...scene_io import active_performer
from ..conditions import Conditional, has_performer, on_whole_frame, outside_shot
from ..key_conditions import has_proposal, is_on_key_pose
from ..reporting import NothingToDoError, reported


class SetKeyPose(Conditional, bpy.types.Operator):
    """Key the pose on this frame, so that tracking meets it exactly, for the bones selected in Pose Mode or otherwise
    the whole body. Tracked keys become your own"""

    bl_idname = "kfmocap.set_key_pose"
    bl_label = "Set Key Pose"
    conditions = (has_performer, on_whole_frame)

    def act(self, context: bpy.types.Context) -> None:
        from ...scene_io.keys import key_pose_curves

        frame = context.scene.frame_current
        for armature, bones in active_performer.posed_bones(context):
            key_pose_curves.key_current_pose(armature, frame, bones)
            self.report({"INFO"}, f"Key pose of {_bones_text(bones)} on frame {frame}")
        if outside := outside_shot(context.scene, frame):
            self.report({"WARNING"}, f"{outside}: the key pose counts for nothing in tracking")


class RemoveKeyPose(Conditional, bpy.types.Operator):
    """Remove your keys on this frame, for the bones selected in Pose Mode or otherwise the whole body: the tracker may
    move the body there again"""

    bl_idname = "kfmocap.remove_key_pose"
    bl_label = "Remove Key Pose"
    conditions = (has_performer, is_on_key_pose)

    def act(self, context: bpy.types.Context) -> None:
        from ...scene_io.keys import key_pose_curves

        frame, removed = context.scene.frame_current, 0
        for armature, bones in active_performer.posed_bones(context):
            removed += key_pose_curves.remove_key_pose(armature, frame, bones)
        if not removed:
            raise NothingToDoError(f"There is no key pose on frame {frame}")


class _Proposals(Conditional):
    """A tool for proposed key poses: on one frame, or all of them."""

    conditions = (has_performer, has_proposal)

    def chosen(self, context: bpy.types.Context, frame: int, every: bool) -> list[int]:
        """Return the chosen frames; an error is reported if they have no proposal."""
        from ...scene_io.keys import key_pose_curves

        frame = frame if frame >= 0 else context.scene.frame_current
        proposed = key_pose_curves.keyed_bones(active_performer.chosen(context).armature)[1]
        found = [f for f in proposed if every or f == frame]
        if not found:
            self.report({"WARNING"}, "There is no proposal" + ("" if every else f" on frame {frame}"))
        return found


class AcceptProposals(_Proposals, bpy.types.Operator):
    """Make a proposed key pose your own, so that tracking meets it exactly"""

    bl_idname = "kfmocap.accept_proposals"
    bl_label = "Accept Proposal"

    every: bpy.props.BoolProperty(name="All", description="All proposals, not only that on one frame")
    frame: bpy.props.IntProperty(default=-1, min=-1, name="Frame", description="Scene frame; -1: the current one")

    @classmethod
    def description(cls, _context: bpy.types.Context, properties: bpy.types.OperatorProperties) -> str:
        if properties.every:
            return "Make all proposed key poses your own, so that tracking meets them exactly"
        return cls.__doc__

    def execute(self, context: bpy.types.Context) -> set[str]:
        from ...scene_io.keys import motion_curves

        with reported(self) as outcome:
            chosen = self.chosen(context, self.frame, self.every)
            if not chosen:
                return {"CANCELLED"}
            motion_curves.accept_proposals(active_performer.chosen(context).armature, chosen)
            text = "The proposal is a key pose" if len(chosen) == 1 else f"{len(chosen)} proposals are key poses"
            self.report({"INFO"}, f"{text} now")
        return outcome.value


class RefuseProposal(_Proposals, bpy.types.Operator):
    """Refuse this proposed key pose, so that it is not proposed again: the motion stays, without a key pose on this
    frame"""

    bl_idname = "kfmocap.refuse_proposal"
    bl_label = "Refuse Proposal"

    frame: bpy.props.IntProperty(default=-1, min=-1, name="Frame", description="Scene frame; -1: the current one")

    def execute(self, context: bpy.types.Context) -> set[str]:
        from ...scene_io.keys import motion_curves

        with reported(self) as outcome:
            chosen = self.chosen(context, self.frame, every=False)
            if not chosen:
                return {"CANCELLED"}
            motion_curves.refuse_proposals(active_performer.chosen(context).armature, chosen)
        return outcome.value


def _bones_text(bones: set[str] | None) -> str:
    return "the whole body" if bones is None else ", ".join(sorted(bones))


CLASSES = (SetKeyPose, RemoveKeyPose, AcceptProposals, RefuseProposal)
