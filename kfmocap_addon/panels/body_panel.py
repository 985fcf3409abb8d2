"""The section "Body": who is tracked."""

import bpy

from ..operators.edit_body import AddBody, EditPart, FinishPart, RemovePerformer, UseArmature, edited_part
from ..operators.fit_body import FitBody
from .section import Section


class BodyPanel(Section, bpy.types.Panel):
    bl_idname = "KFMOCAP_PT_body"
    bl_label = "Body"

    def draw(self, context: bpy.types.Context) -> None:
        layout, performers = self.layout, context.scene.kfmocap.performers
        if not performers:
            layout.label(text="No performer yet", icon="INFO")
        column = layout.column(align=True)
        for index, performer in enumerate(performers):
            row = column.row(align=True)
            row.prop(performer, "name", text="")
            row.prop(performer, "armature", text="")
            row.operator(RemovePerformer.bl_idname, text="", icon="REMOVE").performer = index
        column = layout.column(align=True)
        column.operator_context = "INVOKE_DEFAULT"
        column.operator(AddBody.bl_idname, text="Add Body", icon="OUTLINER_OB_ARMATURE")
        column.operator(UseArmature.bl_idname, icon="ARMATURE_DATA")
        if not performers:
            return
        row = layout.row(align=True)
        row.operator(FitBody.bl_idname, icon="MOD_SIMPLEDEFORM").adjust_poses = False
        row.operator(FitBody.bl_idname, text="With Poses").adjust_poses = True
        if edited_part(context) is None:
            layout.operator(EditPart.bl_idname, icon="EDITMODE_HLT")
        else:
            layout.operator(FinishPart.bl_idname, icon="CHECKMARK")


CLASSES = (BodyPanel,)
