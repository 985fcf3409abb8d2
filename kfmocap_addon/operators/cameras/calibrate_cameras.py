"""Calibrate: cameras from videos of an L-frame and a wand."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import bpy

from ....core.errors import OutputError
from ....core.runtime.worker_process import Work
from ...scene_io import capture_scene as captures
from ..conditions import Conditional
from ..job_operator import JobOperator

if TYPE_CHECKING:
    from ....core.calibration.calibration_result import CalibrationResult

REPORT = "Calibration Report"


def _capture_is_complete(context: bpy.types.Context) -> str:
    return captures.missing(context.scene.kfmocap_capture)


class Calibrate(Conditional, JobOperator, bpy.types.Operator):
    """Find the balls in all videos, solve for the cameras, and show them with the wand's path. Esc cancels"""

    bl_idname = "kfmocap.calibrate"
    bl_label = "Calibrate"
    conditions = (_capture_is_complete,)

    def prepare(self, context: bpy.types.Context) -> Work:
        from ....core.calibration.api import calibrate

        self._videos = captures.read_capture(context.scene.kfmocap_capture)
        return partial(calibrate, self._videos)

    def finish(self, context: bpy.types.Context, result: CalibrationResult) -> None:
        from ....core.calibration.calibration_report import sheet, write_report
        from ....core.capture.calibration_objects import LFRAME_ARMS
        from ...scene_io import solved_cameras

        scene, capture = context.scene, context.scene.kfmocap_capture
        footage = {view.camera: view.wand for view in self._videos.views}
        offsets = dict(zip(result.rig.names, result.rig.offset, strict=True))
        solved_cameras.show_cameras(scene, result.cameras, footage, offsets)
        ends = result.wand.ends_world
        solved_cameras.show_points(scene, "Wand", ends.reshape(-1, 3), [(2 * k, 2 * k + 1) for k in range(len(ends))])
        solved_cameras.show_points(scene, "L-Frame", result.lframe_world, LFRAME_ARMS)
        solved_cameras.show_picture(REPORT, sheet(result))
        if capture.report:
            write_report(Path(bpy.path.abspath(capture.report)), result)
        for finding in result.findings:
            self.report({"WARNING"}, str(finding))
        self.report({"INFO"}, f"Solved {len(result.cameras)} cameras")


def _has_report(context: bpy.types.Context) -> str:
    return "" if REPORT in bpy.data.images else "There is no report yet: use Calibrate"


class ShowReport(Conditional, bpy.types.Operator):
    """Show the report of the last calibration in an image editor"""

    bl_idname = "kfmocap.show_calibration_report"
    bl_label = "Show Report"
    bl_options = {"REGISTER"}
    conditions = (_has_report,)

    def act(self, context: bpy.types.Context) -> None:
        area = image_area(context)
        if area is None:
            raise OutputError("There is no window to show it in")
        area.spaces.active.image = bpy.data.images[REPORT]


def image_area(context: bpy.types.Context) -> bpy.types.Area | None:
    """Return an open image editor, or else turn the largest area that is not a 3D view into one."""
    areas = list(context.screen.areas) if context.screen is not None else []
    for area in areas:
        if area.type == "IMAGE_EDITOR":
            return area
    others = [area for area in areas if area.type != "VIEW_3D"]
    if not others:
        return None
    area = max(others, key=lambda area: area.width * area.height)
    area.type = "IMAGE_EDITOR"
    return area


CLASSES = (Calibrate, ShowReport)
