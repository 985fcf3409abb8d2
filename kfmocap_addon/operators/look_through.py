"""Look Through: see the footage of one view, of the next, or of up to four."""

import bpy

from ..viewports import screens
from .add_footage import has_views


class LookThrough(bpy.types.Operator):
    """Look through this view's camera, at the size of its footage"""

    bl_idname = "kfmocap.look_through"
    bl_label = "Look Through"
    bl_options = {"REGISTER", "UNDO"}

    view: bpy.props.IntProperty(min=0, name="View", description="Number of the view in the shot, from 0")

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return has_views(cls, context)

    def execute(self, context: bpy.types.Context) -> set[str]:
        slots = context.scene.kfmocap.views
        if self.view >= len(slots) or slots[self.view].camera is None:
            self.report({"ERROR"}, f"The shot has no view {self.view} with a camera")
            return {"CANCELLED"}
        show(context, self.view)
        return {"FINISHED"}


class StepView(bpy.types.Operator):
    """Look through the next view's camera, or the one before"""

    bl_idname = "kfmocap.step_view"
    bl_label = "Next View"
    bl_options = {"REGISTER", "UNDO"}

    step: bpy.props.IntProperty(default=1, name="Step", description="1: the next view; -1: the one before")

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return has_views(cls, context)

    @classmethod
    def description(cls, _context: bpy.types.Context, properties: bpy.types.OperatorProperties) -> str:
        return f"Look through the camera of the {'next' if properties.step > 0 else 'previous'} view"

    def execute(self, context: bpy.types.Context) -> set[str]:
        shot = context.scene.kfmocap
        usable = [i for i, view in enumerate(shot.views) if view.camera is not None]
        if not usable:
            self.report({"ERROR"}, "No view has a camera any more")
            return {"CANCELLED"}
        place = usable.index(shot.shown_view) + self.step if shot.shown_view in usable else 0
        show(context, usable[place % len(usable)])
        return {"FINISHED"}


class QuadView(bpy.types.Operator):
    """Show up to four views side by side, beginning with the one that is looked through; again for a single one"""

    bl_idname = "kfmocap.quad_view"
    bl_label = "Quad View"
    bl_options = {"REGISTER"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        if len([view for view in context.scene.kfmocap.views if view.camera is not None]) < 2:
            cls.poll_message_set("There are no two views to show side by side")
            return False
        if bpy.app.background or screens.view3d_of(context) is None:
            cls.poll_message_set("There is no 3D view to split")
            return False
        return True

    def execute(self, context: bpy.types.Context) -> set[str]:
        if len(screens.layout_of(context.window)) > 1:
            screens.join(context)
            return {"FINISHED"}
        shot = context.scene.kfmocap
        cameras = [view.camera for view in shot.views if view.camera is not None]
        start = cameras.index(context.scene.camera) if context.scene.camera in cameras else 0
        ordered = cameras if len(cameras) <= screens.MOST else (cameras[start:] + cameras[:start])[: screens.MOST]
        screens.split(context, ordered)
        return {"FINISHED"}


def show(context: bpy.types.Context, index: int) -> None:
    """Look through a view's camera."""
    from ..scene_io import footage_background

    footage_background.look_through(context.scene, context.scene.kfmocap.views[index])
    screens.look(context)


CLASSES = (LookThrough, StepView, QuadView)
