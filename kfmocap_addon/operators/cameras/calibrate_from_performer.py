"""Calibrate from Performer: cameras from 2D keypoints of somebody who moves about, without a wand."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

import bpy

from ....core.runtime.processes.worker_process import Work
from ...scene_io import active_performer
from ..conditions import Conditional, has_footage, has_views
from ..job_operator import JobOperator

if TYPE_CHECKING:
    from ....core.calibration.performer.performer_cameras import PerformerCalibration
    from ....core.calibration.performer.single_camera import SingleViewCalibration

_BY_HAND = "Or give the camera its lens and place by hand, and tick Calibrated in Look Through > View"


def _views_have_keypoints(context: bpy.types.Context) -> str:
    without = next((view.name for view in context.scene.kfmocap.views if not view.keypoints), None)
    return "" if without is None else f"{without} has no 2D keypoints yet: use Import Keypoints. {_BY_HAND}"


def height_owner(context: bpy.types.Context) -> tuple[bpy.types.PropertyGroup, str]:
    """Return the owner and the name of the property with the height of the performer to calibrate from.

    It is that of the chosen performer's body or, if there is none yet, the height entered in the panel.
    """
    slot = active_performer.chosen(context)
    return (context.scene.kfmocap_capture, "performer_height") if slot is None else (slot, "height")


class CalibrateFromPerformer(Conditional, JobOperator, bpy.types.Operator):
    """Find the cameras of all views from the 2D keypoints of a performer who walks about, and from their height: for
    shots without a wand. Key poses stay as they are. Esc cancels"""

    bl_idname = "kfmocap.calibrate_from_performer"
    bl_label = "Calibrate from Performer"
    conditions = (has_views, has_footage, _views_have_keypoints)

    def prepare(self, context: bpy.types.Context) -> Work:
        from ....core.calibration.performer.performer_cameras import cameras_of_views
        from ....core.keypoints.observations import correlated_frames
        from ...scene_io.cameras import camera_poses, view_cameras
        from ...scene_io.scene import frame_rate, read_settings

        scene, shot = context.scene, context.scene.kfmocap
        camera_poses.check_can_be_placed(shot.views)
        lenses = view_cameras.known_lenses(scene)
        owner, name = height_owner(context)
        return partial(
            cameras_of_views,
            view_cameras.read_specs(scene),
            getattr(owner, name),
            (shot.first, shot.last),
            lenses=lenses,
            correlated=correlated_frames(read_settings(shot), frame_rate(scene)),
        )

    def finish(self, context: bpy.types.Context, result: PerformerCalibration | SingleViewCalibration) -> None:
        from ...scene_io import added_views
        from ...scene_io.cameras import view_cameras

        scene = context.scene
        known = set(view_cameras.known_lenses(scene))
        added_views.calibrate_views(scene, result.cameras)
        for view in scene.kfmocap.views:
            view.lens_known = view.name in known
        scene.kfmocap_capture.performer_summary = "\n".join(result.summary_lines)
        count = len(result.cameras)
        self.report({"INFO"}, f"{count} camera{' was' if count == 1 else 's were'} found: see below")


CLASSES = (CalibrateFromPerformer,)
