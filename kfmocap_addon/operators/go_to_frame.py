"""Go to Frame: jump to a frame on which a key pose would help."""

import bpy


class GoToFrame(bpy.types.Operator):
    """Jump to a frame"""

    bl_idname = "kfmocap.go_to_frame"
    bl_label = "Go to Frame"
    bl_options = {"INTERNAL"}

    frame: bpy.props.IntProperty(name="Frame", description="Scene frame to go to")
    reason: bpy.props.StringProperty(name="Reason", description="What there is to do at that frame")

    @classmethod
    def description(cls, _context: bpy.types.Context, properties: bpy.types.OperatorProperties) -> str:
        return properties.reason or cls.__doc__

    def execute(self, context: bpy.types.Context) -> set[str]:
        context.scene.frame_set(self.frame)
        return {"FINISHED"}


CLASSES = (GoToFrame,)
