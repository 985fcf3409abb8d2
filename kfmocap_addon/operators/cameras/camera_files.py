"""Importing and exporting cameras."""

from pathlib import Path

import bpy

from ..conditions import Conditional
from ..footage.add_footage import CALIBRATIONS, globbed
from ..footage.file_world import CalibrationReader
from ..mixin import FileReader


class ImportCameras(CalibrationReader, FileReader, bpy.types.Operator):
    """Show the cameras of a calibration file as camera objects"""

    bl_idname = "kfmocap.import_cameras"
    bl_label = "Import Cameras"

    filepath: bpy.props.StringProperty(
        subtype="FILE_PATH",
        name="Calibration",
        description="TOML of ours, aniposelib, Pose2Sim or Caliscope; .qca.txt of Qualisys; .yml or .json of OpenCV",
    )
    filter_glob: bpy.props.StringProperty(default=globbed(CALIBRATIONS), options={"HIDDEN"})

    def read(self, context: bpy.types.Context, path: Path) -> None:
        from ...scene_io import solved_cameras

        cameras = self.cameras_in(path)
        solved_cameras.show_cameras(context.scene, cameras)
        self.report({"INFO"}, f"{len(cameras)} cameras: footage that is named like one gets it")


def _has_cameras(context: bpy.types.Context) -> str:
    """The scene has a camera."""
    found = any(thing.type == "CAMERA" for thing in context.scene.objects)
    return "" if found else "The scene has no camera to write: calibrate, or import cameras"


class ExportCameras(Conditional, bpy.types.Operator):
    """Write camera objects as a calibration file: those selected, else the calibrated ones, else all. Cameras that
    move, such as one that Blender's own tracker solved, are written frame by frame"""

    bl_idname = "kfmocap.export_cameras"
    bl_label = "Export Cameras"
    bl_options = {"REGISTER"}
    conditions = (_has_cameras,)
    while_placing = True

    filepath: bpy.props.StringProperty(
        subtype="FILE_PATH",
        name="Calibration",
        default="calibration.toml",
        description="Its extension says which kind: .toml, .qca.txt of Qualisys, .yml or .json of OpenCV",
    )
    filter_glob: bpy.props.StringProperty(default=globbed(CALIBRATIONS), options={"HIDDEN"})

    def invoke(self, context: bpy.types.Context, _event: bpy.types.Event) -> set[str]:
        context.window_manager.fileselect_add(self)
        return {"RUNNING_MODAL"}

    def act(self, context: bpy.types.Context) -> None:
        from ....core.formats.calibrations.calibration_files import export_cameras
        from ...scene_io import solved_cameras
        from ...scene_io.cameras import scene_cameras

        scene = context.scene
        owners = solved_cameras.camera_objects(scene, context.selected_objects)
        length = scene.frame_end - scene.frame_start + 1
        cameras = scene_cameras.read_cameras(scene, owners, scene.frame_start, length)
        path = Path(bpy.path.abspath(self.filepath))
        export_cameras(path, cameras)
        self.report({"INFO"}, f"Wrote {len(cameras)} cameras to {path}")


CLASSES = (ImportCameras, ExportCameras)
