"""Files dropped onto the 3D view: footage, calibrations, shot files."""

import bpy

from .add_footage import CALIBRATIONS, VIDEOS
from .reporting import reported


class OpenFile(bpy.types.Operator):
    """Open a file by what it holds: a shot becomes a scene, a calibration is given to the views or shown as cameras, a
    capture of L-frame and wand fills in Calibration"""

    bl_idname = "kfmocap.open_file"
    bl_label = "Open Shot or Calibration"
    bl_options = {"REGISTER", "UNDO"}

    filepath: bpy.props.StringProperty(
        subtype="FILE_PATH",
        name="File",
        description="A shot file, a calibration, or a capture of L-frame and wand",
        options={"SKIP_SAVE"},
    )

    def execute(self, context: bpy.types.Context) -> set[str]:
        from ...core.formats.kinds import file_kind

        tools, path = bpy.ops.kfmocap, bpy.path.abspath(self.filepath)
        with reported(self) as outcome:
            cameras = tools.import_calibration if context.scene.kfmocap.views else tools.import_cameras
            tool = {"shot": tools.load_shot, "capture": tools.load_capture, "calibration": cameras}[file_kind(path)]
            outcome.value = run(self, tool, filepath=path)
        return outcome.value


def run(operator: bpy.types.Operator, tool: object, **settings: object) -> set[str]:
    """Run another tool; what it reports as an error is this one's."""
    try:
        return tool("EXEC_DEFAULT", **settings)
    except RuntimeError as error:
        operator.report({"ERROR"}, str(error).removeprefix("Error: ").strip())
        return {"CANCELLED"}


class DroppedFootage(bpy.types.FileHandler):
    bl_idname = "KFMOCAP_FH_footage"
    bl_label = "KF Mocap Footage"
    bl_import_operator = "kfmocap.add_footage"
    bl_file_extensions = VIDEOS

    @classmethod
    def poll_drop(cls, context: bpy.types.Context) -> bool:
        return is_view3d(context)


class DroppedFile(bpy.types.FileHandler):
    bl_idname = "KFMOCAP_FH_file"
    bl_label = "KF Mocap Shot or Calibration"
    bl_import_operator = OpenFile.bl_idname
    bl_file_extensions = CALIBRATIONS

    @classmethod
    def poll_drop(cls, context: bpy.types.Context) -> bool:
        return is_view3d(context)


def is_view3d(context: bpy.types.Context) -> bool:
    """Whether the mouse is over a 3D view."""
    return context.area is not None and context.area.type == "VIEW_3D"


CLASSES = (OpenFile, DroppedFootage, DroppedFile)
