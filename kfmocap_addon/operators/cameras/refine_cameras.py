"""Refine Cameras: moving cameras until the key poses lie on the performers."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

import bpy

from ....core.runtime.processes.worker_process import Work
from ..conditions import Conditional, has_footage, has_shot
from ..job_operator import JobOperator

if TYPE_CHECKING:
    from ....core.fitting.camera_fits.camera_refinement import Refinement


class RefineCameras(Conditional, JobOperator, bpy.types.Operator):
    """Move, turn and zoom the cameras a little, until they agree on the keypoints that they share, and your key poses
    of the whole body lie on the performers in the footage. The key poses stay as they are. Esc cancels"""

    bl_idname = "kfmocap.refine_cameras"
    bl_label = "Refine Cameras"
    conditions = (has_shot, has_footage)

    def prepare(self, context: bpy.types.Context) -> Work:
        from ....core.fitting.shot_cameras import refine_shot_cameras
        from ...scene_io import scene as scenes
        from ...scene_io.cameras import camera_poses

        shot = scenes.shot_from_scene(context.scene)
        camera_poses.check_can_be_placed(context.scene.kfmocap.views)
        return partial(refine_shot_cameras, shot)

    def finish(self, context: bpy.types.Context, result: Refinement) -> None:
        from ...scene_io.cameras import view_cameras

        properties = context.scene.kfmocap
        for slot, found in zip(properties.views, result.views, strict=True):
            if not found.lost:
                view_cameras.show_camera(slot, found.camera, properties.frame_start)
            self.report({"WARNING" if found.lost else "INFO"}, found.summary)


CLASSES = (RefineCameras,)
