"""Look Through: see the footage of one view."""

import bpy


class LookThrough(bpy.types.Operator):
    """Look through this view's camera, at the size of its footage"""

    bl_idname = "kfmocap.look_through"
    bl_label = "Look Through"
    bl_options = {"REGISTER", "UNDO"}

    view: bpy.props.IntProperty(min=0, name="View", description="Number of the view in the shot, from 0")

    def execute(self, context: bpy.types.Context) -> set[str]:
        from .. import views

        slots = context.scene.kfmocap.views
        if self.view >= len(slots) or slots[self.view].camera is None:
            self.report({"ERROR"}, f"The shot has no view {self.view} with a camera")
            return {"CANCELLED"}
        views.look_through(context.scene, slots[self.view])
        space = context.space_data
        if space is not None and space.type == "VIEW_3D":
            space.use_local_camera = False
            space.region_3d.view_perspective = "CAMERA"
        return {"FINISHED"}


CLASSES = (LookThrough,)
