"""Calibrate: cameras from videos of an L-frame and a wand."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import bpy

from ....core.errors import OutputError
from ....core.runtime.processes.worker_process import Work
from ...scene_io import capture_scene as captures
from ..conditions import Conditional
from ..job_operator import JobOperator

if TYPE_CHECKING:
    from ....core.calibration.calibration_result import CalibrationResult
    from ....core.numerics.arrays import Array

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
        found = f"{len(result.cameras)} cameras, reprojection error {_typical_length(result.residual):.2f} pixels"
        capture.summary = "\n".join([f"Found {found}", *map(str, result.findings)])
        for finding in result.findings:
            self.report({"WARNING"}, str(finding))
        self.report({"INFO"}, f"Found {found}")


def _typical_length(residual: Array) -> float:
    """Return the root mean square length of residuals (n, 2)."""
    return float((residual**2).sum(axis=1).mean() ** 0.5)


def _has_report(context: bpy.types.Context) -> str:
    return "" if REPORT in bpy.data.images else "There is no report yet: use Calibrate"


class ShowReport(Conditional, bpy.types.Operator):
    """Show the report of the last calibration, in an image editor or a window of its own"""

    bl_idname = "kfmocap.show_calibration_report"
    bl_label = "Show Report"
    bl_options = {"REGISTER"}
    conditions = (_has_report,)

    def act(self, context: bpy.types.Context) -> None:
        window, area = _image_editor(context)
        area.spaces.active.image = bpy.data.images[REPORT]
        region = next(region for region in area.regions if region.type == "WINDOW")
        with context.temp_override(window=window, screen=window.screen, area=area, region=region):
            bpy.ops.image.view_all(fit_view=True)


def _image_editor(context: bpy.types.Context) -> tuple[bpy.types.Window, bpy.types.Area]:
    """Return an image editor that is open in some window, or else one in a new window.

    Raises
    ------
    OutputError
        Blender has no windows.
    """
    windows = context.window_manager.windows
    for window in windows:
        for area in window.screen.areas:
            if area.type == "IMAGE_EDITOR":
                return window, area
    if bpy.app.background:
        raise OutputError("There is no window to show it in")
    bpy.ops.wm.window_new()
    area = windows[-1].screen.areas[0]
    area.type = "IMAGE_EDITOR"
    return windows[-1], area


CLASSES = (Calibrate, ShowReport)
