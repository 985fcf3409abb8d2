"""The section "Body": who is tracked."""

import bpy

from .section import Section


class BodyPanel(Section, bpy.types.Panel):
    bl_idname = "KFMOCAP_PT_body"
    bl_label = "Body"

    def draw(self, context: bpy.types.Context) -> None:
        layout, performers = self.layout, context.scene.kfmocap.performers
        layout.use_property_split, layout.use_property_decorate = True, False
        if not performers:
            layout.label(text="No performer yet", icon="INFO")
        for performer in performers:
            layout.prop(performer, "armature", text=performer.name)


CLASSES = (BodyPanel,)
