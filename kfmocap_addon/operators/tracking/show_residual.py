"""Show Residual: where the footage contradicts the model on this frame."""

import bpy

from ..conditions import Conditional, frame_is_in_shot, has_footage, has_shot, looks_through_view
from ..key_conditions import has_whole_key_pose


class ShowResidual(Conditional, bpy.types.Operator):
    """Show on this frame, in the view that is looked through, where the footage contradicts the model: orange where the
    performer is not covered by the model, blue where the model covers background. The picture can be opened in an image
    editor, too"""

    bl_idname = "kfmocap.show_residual"
    bl_label = "Show Residual"
    conditions = (has_shot, has_footage, has_whole_key_pose, frame_is_in_shot(), looks_through_view)

    def act(self, context: bpy.types.Context) -> None:
        from ...overlays import misfit_backgrounds

        slot = context.scene.kfmocap.views[context.scene.kfmocap.shown_view]
        found = misfit_backgrounds.show(context.scene, slot, context.scene.frame_current)
        for area in context.screen.areas if context.screen is not None else ():
            if area.type == "IMAGE_EDITOR":
                area.spaces.active.image = slot.residual
        self.report(
            {"INFO"},
            f"{slot.name}, frame {context.scene.frame_current}: of the model's area, {found.uncovered:.0%} lies "
            f"uncovered beside it, and {found.beyond:.0%} of it covers background",
        )


def _shows_residual(context: bpy.types.Context) -> str:
    shown = any(view.residual is not None for view in context.scene.kfmocap.views)
    return "" if shown else "No residual is shown"


class HideResidual(Conditional, bpy.types.Operator):
    """Remove the residual pictures"""

    bl_idname = "kfmocap.hide_residual"
    bl_label = "Hide Residual"
    conditions = (_shows_residual,)

    def act(self, context: bpy.types.Context) -> None:
        from ...overlays import misfit_backgrounds

        misfit_backgrounds.hide(context.scene)


CLASSES = (ShowResidual, HideResidual)
