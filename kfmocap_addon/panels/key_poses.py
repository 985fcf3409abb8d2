"""The section "Key Poses": the poses that tracking meets."""

import bpy

from ..operators.place_joints import PlaceJoints
from ..operators.set_key_pose import SetKeyPose
from .section import Section


class KeyPosesPanel(Section, bpy.types.Panel):
    bl_idname = "KFMOCAP_PT_key_poses"
    bl_label = "Key Poses"

    def draw(self, _context: bpy.types.Context) -> None:
        self.layout.operator(PlaceJoints.bl_idname, icon="OUTLINER_OB_ARMATURE")
        self.layout.operator(SetKeyPose.bl_idname, icon="KEY_HLT")


CLASSES = (KeyPosesPanel,)
