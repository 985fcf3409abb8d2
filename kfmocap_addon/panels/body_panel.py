"""The section "Body": who is tracked."""

import bpy

from ..operators.footage.recover import RestoreBody
from ..operators.performers.edit_body import AddBody, EditPart, FinishPart, RemovePerformer, UseArmature, edited_part
from ..operators.performers.fit_body import FitBody
from ..operators.performers.hold_prop import HoldProp, RemoveHold
from ..properties.body_fields import MEASURES
from ..scene_io import active_performer, hold_checks
from . import performer_rows
from .section import FoldedPart, PerformerPart, Section, SectionPart, draw_as_form
from .texts import draw_hidden, draw_text, draw_unit_scale


class BodyPanel(Section, bpy.types.Panel):
    bl_idname = "KFMOCAP_PT_body"
    bl_label = "Body"

    def draw_content(self, context: bpy.types.Context) -> None:
        layout, performers = self.layout, context.scene.kfmocap.performers
        if not performers:
            layout.label(text="No performer yet", icon="INFO")
        draw_unit_scale(layout, context)
        column = layout.column(align=True)
        for index, performer in enumerate(performers):
            _draw_performer(column.row(align=True), context, performer, index)
        column = layout.column(align=True)
        column.operator_context = "INVOKE_DEFAULT"
        column.operator(AddBody.bl_idname, text="Add Body", icon="OUTLINER_OB_ARMATURE")
        column.operator(UseArmature.bl_idname, icon="ARMATURE_DATA")
        slot = active_performer.chosen(context)
        if slot is None:
            return
        draw_hidden(layout, context, slot.armature, "The body")
        column = layout.column()
        draw_as_form(column)
        column.enabled = slot.armature.mode != "EDIT"
        column.prop(slot, "height")
        column = layout.column(align=True)
        column.operator(FitBody.bl_idname, icon="MOD_SIMPLEDEFORM").adjust_poses = False
        column.operator(FitBody.bl_idname, text="Fit Body and Key Poses").adjust_poses = True
        if edited_part(context) is None:
            layout.operator(EditPart.bl_idname, icon="EDITMODE_HLT")
        else:
            layout.operator(FinishPart.bl_idname, icon="CHECKMARK")


def _draw_performer(
    row: bpy.types.UILayout, context: bpy.types.Context, slot: bpy.types.PropertyGroup, index: int
) -> None:
    """Draw name, colour and armature of a performer; if the armature was deleted, a button that restores it."""
    if len(context.scene.kfmocap.performers) > 1 and active_performer.is_present(context.scene, slot):
        performer_rows.draw_choice(row, context, slot, "")
    row.prop(slot, "name", text="")
    if active_performer.is_present(context.scene, slot):
        row.prop(slot, "armature", text="")
        colour = row.row(align=True)
        colour.ui_units_x = 1.2
        colour.prop(slot, "colour", text="")
    elif slot.armature is not None:
        row.label(text="deleted", icon="ERROR")
        row.operator(RestoreBody.bl_idname).performer = index
    else:
        row.label(text="its body is gone", icon="ERROR")
    row.operator(RemovePerformer.bl_idname, text="", icon="REMOVE").performer = index


class ProportionsPanel(FoldedPart, PerformerPart, bpy.types.Panel):
    bl_idname = "KFMOCAP_PT_proportions"
    bl_label = "Proportions"
    bl_parent_id = BodyPanel.bl_idname

    def draw(self, context: bpy.types.Context) -> None:
        layout, slot = self.layout, active_performer.chosen(context)
        draw_as_form(layout)
        known = [name for name in MEASURES if getattr(slot, name)]
        if not known:
            draw_text(layout, context, _why_unknown(slot.armature), "INFO")
        column = layout.column(align=True)
        column.enabled = slot.armature.mode != "EDIT"
        for name in known:
            column.prop(slot, name)


def _why_unknown(armature: bpy.types.Object) -> str:
    """Return why a body has no proportions that can be changed."""
    from ..scene_io.body.part_meshes import is_of_skin  # loads NumPy, which must not slow down Blender's start

    if is_of_skin(armature):
        return "A skinned character keeps its proportions: change its height"
    return "Its bones are not those of a body of ours"


class HoldsPanel(SectionPart, bpy.types.Panel):
    bl_idname = "KFMOCAP_PT_holds"
    bl_label = "Props in Hands"
    bl_parent_id = BodyPanel.bl_idname

    @classmethod
    def is_needed(cls, context: bpy.types.Context) -> bool:
        """Check whether there may be a prop and somebody to hold it."""
        return len(context.scene.kfmocap.performers) > 1 or bool(context.scene.kfmocap.holds)

    def draw(self, context: bpy.types.Context) -> None:
        layout, scene = self.layout, context.scene
        for number, hold in enumerate(scene.kfmocap.holds):
            column = layout.column(align=True)
            row = column.row(align=True)
            row.prop(hold, "prop", text="")
            row.operator(RemoveHold.bl_idname, text="", icon="REMOVE").number = number
            row = column.row(align=True)
            row.prop(hold, "holder", text="")
            if hold.holder is not None:
                row.prop_search(hold, "bone", hold.holder.data, "bones", text="")
            row = column.row(align=True)
            row.prop(hold, "first")
            row.prop(hold, "last")
            if reason := hold_checks.why_unused(scene, hold):
                draw_text(column, context, reason, "ERROR")
        layout.operator(HoldProp.bl_idname, icon="CONSTRAINT_BONE")


CLASSES = (BodyPanel, ProportionsPanel, HoldsPanel)
