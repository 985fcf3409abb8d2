"""What Blender is told of: classes, the scene's properties, the command."""

from __future__ import annotations

import bpy

from . import calibration_panel, capture, panels, properties
from .operators import (
    calibrate,
    cameras,
    capture_views,
    export,
    go_to_frame,
    load_shot,
    look_through,
    pick_colour,
    refine_cameras,
    set_key_pose,
    track,
)

CLASSES = (
    properties.KFMocapView,
    properties.KFMocapSuggestion,
    properties.KFMocapPerformer,
    properties.KFMocapScene,
    capture.KFMocapColour,
    capture.KFMocapCaptureView,
    capture.KFMocapCapture,
    load_shot.LoadShot,
    look_through.LookThrough,
    refine_cameras.RefineCameras,
    set_key_pose.SetKeyPose,
    go_to_frame.GoToFrame,
    track.Track,
    export.Export,
    cameras.ImportCameras,
    cameras.ExportCameras,
    capture_views.AddVideos,
    capture_views.RemoveVideos,
    capture_views.LoadCapture,
    pick_colour.PickColour,
    calibrate.Calibrate,
    calibrate.ShowReport,
    panels.ShotPanel,
    panels.ViewsPanel,
    panels.TrackPanel,
    panels.OcclusionPanel,
    panels.ExportPanel,
    calibration_panel.CaptureViewList,
    calibration_panel.CalibrationPanel,
    calibration_panel.CapturePanel,
    calibration_panel.BallsPanel,
)
COMMAND = "kfmocap"

_register_classes, _unregister_classes = bpy.utils.register_classes_factory(CLASSES)
_commands: list[object] = []


def register() -> None:
    _register_classes()
    bpy.types.Scene.kfmocap = bpy.props.PointerProperty(type=properties.KFMocapScene)
    bpy.types.Scene.kfmocap_capture = bpy.props.PointerProperty(type=capture.KFMocapCapture)
    if hasattr(bpy.utils, "register_cli_command"):
        _commands.append(bpy.utils.register_cli_command(COMMAND, _command))


def unregister() -> None:
    while _commands:
        bpy.utils.unregister_cli_command(_commands.pop())
    del bpy.types.Scene.kfmocap_capture
    del bpy.types.Scene.kfmocap
    _unregister_classes()


def is_registered() -> bool:
    return hasattr(bpy.types.Scene, "kfmocap")


def _command(argv: list[str]) -> int:
    from . import command_line

    return command_line.main(argv)
