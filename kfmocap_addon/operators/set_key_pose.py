"""Set Key Pose: the pose that is shown becomes one that the tracker must meet."""

import bpy

from .reporting import explained, reported


class SetKeyPose(bpy.types.Operator):
    """Key the pose on this frame, so that tracking meets it exactly: bones selected in pose mode,
    else the whole body. Tracked keys become your own"""

    bl_idname = "kfmocap.set_key_pose"
    bl_label = "Set Key Pose"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        if not explained(cls, context):
            return False
        if _performers(context):
            return True
        cls.poll_message_set("Select a performer's armature")
        return False

    def execute(self, context: bpy.types.Context) -> set[str]:
        from .. import curves

        with reported(self) as outcome:
            selected = (context.mode == "POSE" and context.selected_pose_bones) or []
            for armature in _performers(context):
                chosen = {bone.name for bone in selected if bone.id_data == armature}
                if chosen or not selected:
                    curves.key_current_pose(armature, context.scene.frame_current, chosen or None)
        return outcome.value


def _performers(context: bpy.types.Context) -> list[bpy.types.Object]:
    """The performers' armatures that are selected or in pose mode; the only one even where it is not."""
    armatures = [slot.armature for slot in context.scene.kfmocap.performers if slot.armature is not None]
    if len(armatures) == 1:
        return armatures
    return [a for a in armatures if a.select_get() or a.mode == "POSE"]


CLASSES = (SetKeyPose,)
