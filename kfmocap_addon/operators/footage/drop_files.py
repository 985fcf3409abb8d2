"""Files dropped onto the 3D view: footage, calibrations, shot files, keypoints and landmarks."""

from __future__ import annotations

from typing import TYPE_CHECKING

import bpy

from ..reporting import reported
from .add_footage import CALIBRATIONS, VIDEOS

if TYPE_CHECKING:
    from collections.abc import Callable


class OpenFile(bpy.types.Operator):
    """Open a file according to what it holds: a shot becomes a scene, a calibration is given to the views or shown as
    cameras, a capture of L-frame and wand fills in Calibration, 2D keypoints go to the view with the same name, 3D
    landmarks become key poses"""

    bl_idname = "kfmocap.open_file"
    bl_label = "Open File"
    bl_options = {"REGISTER", "UNDO"}

    filepath: bpy.props.StringProperty(
        subtype="FILE_PATH",
        name="File",
        description="A shot file, a calibration, a capture of L-frame and wand, 2D keypoints, or 3D landmarks",
        options={"SKIP_SAVE"},
    )

    def execute(self, context: bpy.types.Context) -> set[str]:
        from ....core.formats.file_kind import file_kind

        tools, path = bpy.ops.kfmocap, bpy.path.abspath(self.filepath)
        with reported(self) as outcome:
            cameras = tools.import_calibration if context.scene.kfmocap.views else tools.import_cameras
            tool = {
                "shot": tools.load_shot,
                "capture": tools.load_capture,
                "calibration": cameras,
                "keypoints": tools.import_keypoints,
                "landmarks": tools.pose_from_landmarks,
            }
            outcome.value = run_operator(self, tool[file_kind(path)], filepath=path)
        return outcome.value


def run_operator(operator: bpy.types.Operator, tool: Callable[..., set[str]], **settings: object) -> set[str]:
    """Run another operator, and report its errors as those of this one."""
    try:
        return tool("EXEC_DEFAULT", **settings)
    except RuntimeError as error:
        operator.report({"ERROR"}, str(error).removeprefix("Error: ").strip())
        return {"CANCELLED"}


class DroppedFootage(bpy.types.FileHandler):
    """Videos dropped onto a 3D view become views."""

    bl_idname = "KFMOCAP_FH_footage"
    bl_label = "KF Mocap Footage"
    bl_import_operator = "kfmocap.add_footage"
    bl_file_extensions = VIDEOS

    @classmethod
    def poll_drop(cls, context: bpy.types.Context) -> bool:
        return is_view3d(context)


class DroppedFile(bpy.types.FileHandler):
    """Other files dropped onto a 3D view are opened by what they hold."""

    bl_idname = "KFMOCAP_FH_file"
    bl_label = "KF Mocap File"
    bl_import_operator = OpenFile.bl_idname
    bl_file_extensions = f"{CALIBRATIONS};.trc;.c3d"

    @classmethod
    def poll_drop(cls, context: bpy.types.Context) -> bool:
        return is_view3d(context)


def is_view3d(context: bpy.types.Context) -> bool:
    """Whether the mouse is over a 3D view."""
    return context.area is not None and context.area.type == "VIEW_3D"


CLASSES = (OpenFile, DroppedFootage, DroppedFile)
