"""The section "Track": the frames between the key poses."""

import bpy

from ..operators.track import Track
from .section import Section


class TrackPanel(Section, bpy.types.Panel):
    bl_idname = "KFMOCAP_PT_track"
    bl_label = "Track"

    def draw(self, context: bpy.types.Context) -> None:
        self.layout.prop(context.scene.kfmocap, "solver", text="")
        self.layout.operator(Track.bl_idname, icon="TRACKING_FORWARDS")


CLASSES = (TrackPanel,)
