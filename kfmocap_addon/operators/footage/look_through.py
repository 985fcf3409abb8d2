"""Look Through: show the footage of one view, of the next one, or of up to four."""

import bpy

from ...viewports import screens
from ..conditions import Conditional, has_views, is_placing


class LookThrough(Conditional, bpy.types.Operator):
    """Look through this view's camera, at the size of its footage"""

    bl_idname = "kfmocap.look_through"
    bl_label = "Look Through"
    conditions = (has_views,)
    while_placing = True

    view: bpy.props.IntProperty(min=0, name="View", description="Number of the view in the shot, from 0")

    def execute(self, context: bpy.types.Context) -> set[str]:
        slots = context.scene.kfmocap.views
        if self.view >= len(slots) or slots[self.view].camera is None:
            self.report({"ERROR"}, f"The shot has no view {self.view} with a camera")
            return {"CANCELLED"}
        show_view(context, self.view)
        return _ended(context)


def _has_other_view(context: bpy.types.Context) -> str:
    shot = context.scene.kfmocap
    others = any(view.camera is not None for i, view in enumerate(shot.views) if i != shot.shown_view)
    return "" if others else "There is no other view to look through"


class StepView(Conditional, bpy.types.Operator):
    """Look through the next view's camera, or the one before"""

    bl_idname = "kfmocap.step_view"
    bl_label = "Previous or Next View"
    conditions = (has_views, _has_other_view)
    while_placing = True

    step: bpy.props.IntProperty(default=1, name="Step", description="1: the next view; -1: the one before")

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
        show_view(context, usable[place % len(usable)])
        return _ended(context)


def _has_two_cameras(context: bpy.types.Context) -> str:
    several = sum(view.camera is not None for view in context.scene.kfmocap.views) > 1
    return "" if several else "There are no two views to show side by side"


def _has_3d_view(context: bpy.types.Context) -> str:
    found = not bpy.app.background and screens.view3d_of(context) is not None
    return "" if found else "There is no 3D view to split"


class QuadView(Conditional, bpy.types.Operator):
    """Show up to four views side by side, beginning with the one that is looked through; again for a single one"""

    bl_idname = "kfmocap.quad_view"
    bl_label = "Quad View"
    bl_options = {"REGISTER"}
    conditions = (_has_two_cameras, _has_3d_view)
    while_placing = True

    def execute(self, context: bpy.types.Context) -> set[str]:
        if len(screens.layout_of(context.window)) > 1:
            screens.join(context)
            return {"FINISHED"}
        shot = context.scene.kfmocap
        cameras = [view.camera for view in shot.views if view.camera is not None]
        start = cameras.index(context.scene.camera) if context.scene.camera in cameras else 0
        ordered = (
            cameras if len(cameras) <= screens.MAX_VIEWS else (cameras[start:] + cameras[:start])[: screens.MAX_VIEWS]
        )
        screens.split(context, ordered)
        return {"FINISHED"}


def _ended(context: bpy.types.Context) -> set[str]:
    """Return the operator's result. CANCELLED makes Blender push no undo step: Place Joints is undone as a whole."""
    return {"CANCELLED" if is_placing(context) else "FINISHED"}


def show_view(context: bpy.types.Context, index: int) -> None:
    """Look through a view's camera."""
    from ...scene_io.cameras import footage_background

    footage_background.look_through(context.scene, context.scene.kfmocap.views[index])
    screens.look(context)


CLASSES = (LookThrough, StepView, QuadView)
