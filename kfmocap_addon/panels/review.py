"""The section "Review": what the cameras saw, and where a key pose would help."""

import bpy

from .. import occlusion
from ..operators.go_to_frame import GoToFrame
from .section import Section


class ReviewPanel(Section, bpy.types.Panel):
    bl_idname = "KFMOCAP_PT_review"
    bl_label = "Review"

    def draw(self, context: bpy.types.Context) -> None:
        tracked = [slot for slot in context.scene.kfmocap.performers if occlusion.is_tracked(slot.armature)]
        if not tracked:
            self.layout.label(text="Not tracked yet", icon="INFO")
        for slot in tracked:
            column = self.layout.column(align=True)
            _draw_hidden(column, slot)
            _draw_suggestions(column, slot)


def _draw_hidden(column: bpy.types.UILayout, slot: bpy.types.PropertyGroup) -> None:
    hidden = occlusion.hidden_parts(slot.armature)
    column.label(text=f"{slot.name}: {'no camera sees' if hidden else 'every part is seen'}")
    for part in hidden:
        column.label(text=part, icon="HIDE_ON")


def _draw_suggestions(column: bpy.types.UILayout, slot: bpy.types.PropertyGroup) -> None:
    if slot.suggestions:
        column.separator()
        column.label(text="A key pose would help at")
    for suggestion in slot.suggestions:
        button = column.operator(GoToFrame.bl_idname, text=f"{suggestion.frame}: {suggestion.name}", icon="KEY_HLT")
        button.frame = suggestion.frame
        first, last = suggestion.hidden
        button.reason = (
            f"Jump there and pose {suggestion.name}: seen on this frame, but by no camera on frames {first} to {last}"
        )


CLASSES = (ReviewPanel,)
