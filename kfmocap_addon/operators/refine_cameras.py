"""Refine Cameras: moved until the key poses lie on the performers."""

import bpy

from .reporting import explained, progress_shown, reported


class RefineCameras(bpy.types.Operator):
    """Move, turn and zoom the cameras a little, until your key poses of the whole body lie on the performers in the
    footage. The key poses stay as they are"""

    bl_idname = "kfmocap.refine_cameras"
    bl_label = "Refine Cameras"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return explained(cls, context)

    def execute(self, context: bpy.types.Context) -> set[str]:
        from ...core.calibration.refine import refine_cameras
        from .. import scene as scenes
        from .. import views
        from ..refinement import told

        properties = context.scene.kfmocap
        with progress_shown(context) as progress, reported(self) as outcome:
            shot = scenes.shot_from_scene(context.scene)
            views.check_can_be_placed(properties.views)
            refinement = refine_cameras(shot, progress)
            for slot, found in zip(properties.views, refinement.views, strict=True):
                if not found.lost:
                    views.show_camera(slot, found.camera, properties.frame_start)
            for view, line in zip(refinement.views, told(refinement), strict=True):
                self.report({"WARNING" if view.lost else "INFO"}, line)
        return outcome.value


CLASSES = (RefineCameras,)
