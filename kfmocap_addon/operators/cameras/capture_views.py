"""The list of a capture's views."""

import re
from pathlib import Path

import bpy
from bpy_extras.io_utils import ImportHelper

from ....core.errors import CalibrationError, FootageError
from ...scene_io import capture_scene as captures
from ..conditions import Conditional
from ..footage.add_footage import VIDEOS, globbed
from ..mixin import FileReader, ReportingOperator

_WAND = re.compile("wand", re.IGNORECASE)


class AddVideos(ReportingOperator, bpy.types.Operator, ImportHelper):
    """Add cameras by their wand videos. A video of the same name with "lframe" instead of "wand" is taken as that
    camera's L-frame video; if some names have "wand", others are left out"""

    bl_idname = "kfmocap.add_videos"
    bl_label = "Add Videos"
    bl_options = {"REGISTER", "UNDO"}

    directory: bpy.props.StringProperty(subtype="DIR_PATH")
    files: bpy.props.CollectionProperty(type=bpy.types.OperatorFileListElement)
    filter_glob: bpy.props.StringProperty(default=globbed(VIDEOS), options={"HIDDEN"})

    def act(self, context: bpy.types.Context) -> None:
        folder = Path(bpy.path.abspath(self.directory))
        chosen = [folder / file.name for file in sorted(self.files, key=lambda file: file.name) if file.name]
        if not chosen:
            raise FootageError("no file is chosen", todo="choose the videos of the wand")
        named = [path for path in chosen if _WAND.search(path.stem)]
        views = context.scene.kfmocap_capture.views
        for path in named or chosen:
            view = views.add()
            view.name, view.wand = camera_name(path), str(path)
            view.lframe = str(_lframe_video(path) or "")
        context.scene.kfmocap_capture.active = len(views) - 1
        of_lframes = {Path(view.lframe) for view in views}
        left = [path.name for path in chosen if named and path not in named and path not in of_lframes]
        if left:
            self.report({"INFO"}, f'Left out, as "wand" is not in their names: {", ".join(left)}')


def _lframe_video(wand: Path) -> Path | None:
    """Return the video beside one of the wand that has "lframe" in place of "wand" in its name, in any case."""
    wanted = _WAND.sub("lframe", wand.name).casefold()
    if wanted == wand.name.casefold():
        return None
    return next((path for path in sorted(wand.parent.glob("*")) if path.name.casefold() == wanted), None)


def camera_name(path: Path) -> str:
    """Return the name of a video without the word that says it shows the wand."""
    name = _WAND.sub("", path.stem).strip("-_. ")
    return name or path.stem


def has_videos(context: bpy.types.Context) -> str:
    """The capture has a camera's videos."""
    return "" if context.scene.kfmocap_capture.views else "Add the cameras' videos first"


class RemoveVideos(Conditional, bpy.types.Operator):
    """Remove the selected camera from the capture"""

    bl_idname = "kfmocap.remove_videos"
    bl_label = "Remove"
    conditions = (has_videos,)

    def act(self, context: bpy.types.Context) -> None:
        capture = context.scene.kfmocap_capture
        capture.views.remove(capture.active)
        capture.active = max(0, min(capture.active, len(capture.views) - 1))


class LoadCapture(FileReader, bpy.types.Operator):
    """Fill in the capture from a file that `kfmocap calibrate` reads"""

    bl_idname = "kfmocap.load_capture"
    bl_label = "Load Capture"

    filepath: bpy.props.StringProperty(subtype="FILE_PATH", name="Capture", description="The capture file (.toml)")
    filter_glob: bpy.props.StringProperty(default="*.toml", options={"HIDDEN"})

    def read(self, context: bpy.types.Context, path: Path) -> None:
        from ....core.capture.capture_videos import CaptureVideos
        from ....core.formats.wand_toml import load_wand

        given = load_wand(path)
        if not isinstance(given, CaptureVideos):
            todo = "calibrate from it with `kfmocap calibrate`"
            raise CalibrationError("it names points, not videos", where=str(path), todo=todo)
        captures.show_capture(context.scene.kfmocap_capture, given)
        self.report({"INFO"}, f"{len(given.views)} views")


CLASSES = (AddVideos, RemoveVideos, LoadCapture)
