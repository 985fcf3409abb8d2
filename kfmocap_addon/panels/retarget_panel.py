"""The section "Send to Rig": the motion on another character."""

import bpy

from ..operators.characters.hand_shape import FingersFromKeypoints, HandShape
from ..operators.characters.retarget_bones import FindBones, ForgetBones, LoadBoneMap, SaveBoneMap
from ..operators.characters.send_to_rig import SendToRig, StopFollowing, TakeMotionBack
from ..properties.pointer_polls import chosen_character
from ..scene_io import active_performer
from .section import Section, draw_as_form
from .texts import draw_text


class BoneList(bpy.types.UIList):
    """Roles and the bones that play them."""

    bl_idname = "KFMOCAP_UL_bones"

    def draw_item(
        self,
        context: bpy.types.Context,
        layout: bpy.types.UILayout,
        _data: bpy.types.PropertyGroup,
        item: bpy.types.PropertyGroup,
        _icon: int,
        _active_data: bpy.types.PropertyGroup,
        _active_property: str,
    ) -> None:
        """Draw the role, and the bone to be chosen for it."""
        target = context.scene.kfmocap.retarget.target
        row = layout.split(factor=0.4)
        row.label(text=item.name if not item.chain else f"{item.name} {item.chain + 1}")
        if target is not None:
            row.prop_search(item, "bone", target.data, "bones", text="")


class RetargetPanel(Section, bpy.types.Panel):
    bl_idname = "KFMOCAP_PT_retarget"
    bl_label = "Send to Rig"

    def draw_content(self, context: bpy.types.Context) -> None:
        layout, settings = self.layout, context.scene.kfmocap.retarget
        draw_as_form(layout)
        layout.prop(settings, "source")
        slot = active_performer.chosen(context)
        if settings.source is None and slot is not None:
            layout.label(text=f"The motion of {slot.name} is sent", icon="ARMATURE_DATA")
        if missing := SendToRig.missing(context):
            draw_text(layout, context, missing, "INFO")
        layout.prop(settings, "target")
        if settings.target is None and (only := chosen_character(context.scene)) is not None:
            layout.label(text=f"{only.name}, the only other armature", icon="ARMATURE_DATA")
        layout.prop(settings, "preset")
        row = layout.row(align=True)
        row.operator(SendToRig.bl_idname, icon="ARMATURE_DATA")
        row.operator(StopFollowing.bl_idname, text="", icon="UNLINKED")
        row.operator(TakeMotionBack.bl_idname, text="", icon="LOOP_BACK")
        layout.prop(settings, "live")
        layout.prop(settings, "root")
        _draw_key_settings(layout, settings)
        _draw_bones(layout, settings)
        fingers = layout.column(align=True)
        fingers.operator_menu_enum(HandShape.bl_idname, "shape", icon="VIEW_PAN")
        fingers.operator(FingersFromKeypoints.bl_idname, icon="VIEW_PAN")
        _draw_errors(layout, settings)


def _draw_key_settings(layout: bpy.types.UILayout, settings: bpy.types.PropertyGroup) -> None:
    """Draw the settings of motion that is sent as keys; constraints have none of them."""
    keys = layout.column()
    keys.active = not settings.live
    keys.prop(settings, "feet")
    keys.prop(settings, "hands")
    keys.prop(settings, "layer")
    keys.prop(settings, "sparse")
    if settings.sparse:
        keys.prop(settings, "angle")
        keys.prop(settings, "distance")


def _draw_bones(layout: bpy.types.UILayout, settings: bpy.types.PropertyGroup) -> None:
    """Draw the bone map: buttons that find, load and save it, and its bones."""
    row = layout.row(align=True)
    row.operator(FindBones.bl_idname, icon="VIEWZOOM")
    row.operator(LoadBoneMap.bl_idname, text="", icon="FILE_FOLDER")
    row.operator(SaveBoneMap.bl_idname, text="", icon="FILE_TICK")
    row.operator(ForgetBones.bl_idname, text="", icon="X")
    if settings.bones:
        layout.template_list(BoneList.bl_idname, "", settings, "bones", settings, "active_bone", rows=6)


def _draw_errors(layout: bpy.types.UILayout, settings: bpy.types.PropertyGroup) -> None:
    if settings.errors:
        column = layout.column(align=True)
        column.label(text="Remaining error, worst:")
        for error in settings.errors:
            row = column.split(factor=0.4)
            row.label(text=error.name)
            row.label(text=f"{error.degrees:.2f}°  {error.distance:.1f} mm")


CLASSES = (BoneList, RetargetPanel)
