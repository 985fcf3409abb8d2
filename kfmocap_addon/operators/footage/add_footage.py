"""Adding views to a scene: footage first, then the cameras that filmed it."""

from __future__ import annotations

from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING

import bpy
from bpy_extras.io_utils import ImportHelper

from ....core.choices import CALIBRATION_ENDINGS
from ....core.errors import ShotError
from ...viewports import screens, timelines
from ..conditions import Conditional, has_views
from ..mixin import BesideFootage
from ..reporting import reported
from .file_world import CalibrationReader

if TYPE_CHECKING:
    from ...scene_io.added_views import Calibrated

VIDEOS = ".mp4;.mov;.avi;.mkv;.mts;.m2ts;.m4v;.mpg;.mpeg;.webm;.mxf"
IMAGES = ".png;.jpg;.jpeg;.bmp;.tif;.tiff;.webp"
CALIBRATIONS = ";".join(dict.fromkeys(Path(f"x{ending}").suffix for ending in chain(*CALIBRATION_ENDINGS.values())))
"""The last parts of the endings alone, as Blender's file browser filters by no more."""


def globbed(endings: str) -> str:
    """Return file endings as a filter pattern of the file browser."""
    return ";".join(f"*{ending}" for ending in endings.split(";"))


class AddFootage(bpy.types.Operator, ImportHelper):
    """Add a view for each chosen video, or for each image sequence of which you choose images. The first footage sets
    the frame rate of the scene and the frames of the shot"""

    bl_idname = "kfmocap.add_footage"
    bl_label = "Add Footage"
    bl_options = {"REGISTER", "UNDO"}

    directory: bpy.props.StringProperty(subtype="DIR_PATH", options={"HIDDEN", "SKIP_SAVE"})
    files: bpy.props.CollectionProperty(type=bpy.types.OperatorFileListElement, options={"HIDDEN", "SKIP_SAVE"})
    filepath: bpy.props.StringProperty(
        subtype="FILE_PATH", name="Footage", description="A video, or an image of a sequence", options={"SKIP_SAVE"}
    )
    filter_glob: bpy.props.StringProperty(default=globbed(f"{VIDEOS};{IMAGES}"), options={"HIDDEN"})

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        if self.directory and self.files:  # dropped onto the window
            return self.execute(context)
        return set(super().invoke(context, event))

    def execute(self, context: bpy.types.Context) -> set[str]:
        from ...scene_io import added_views

        scene = context.scene
        with reported(self) as outcome:
            begins = not scene.kfmocap.views
            names = added_views.add_footage(scene, self._chosen())
            known = added_views.calibrated_by_scene(scene, names)
            hidden = added_views.hide_startup_cube(scene) if begins else ""
            screens.look(context)
            screens.show_footage()
            timelines.show_keys(context)
            remarks = f"; calibrated {', '.join(known)}" if known else ""
            remarks += f". {hidden} is hidden, it stood before the footage: Alt H shows it" if hidden else ""
            if begins and scene.kfmocap.views[0].sequence:
                remarks += f". Images have no frame rate: enter it, if it is not {scene.kfmocap.frame_rate:g}"
            self.report({"INFO"}, f"Added {', '.join(names)}{remarks}")
        return outcome.value

    def _chosen(self) -> list[Path]:
        folder = Path(bpy.path.abspath(self.directory or str(Path(self.filepath).parent)))
        names = [file.name for file in self.files if file.name] or [Path(self.filepath).name]
        return [folder / name for name in names if name]


class ImportCalibration(CalibrationReader, Conditional, bpy.types.Operator, BesideFootage):
    """Assign the cameras of a calibration file to the views, by name"""

    bl_idname = "kfmocap.import_calibration"
    bl_label = "Import Calibration"
    conditions = (has_views,)

    filepath: bpy.props.StringProperty(
        subtype="FILE_PATH",
        name="Calibration",
        description="TOML of ours, aniposelib, Pose2Sim or Caliscope; .qca.txt of Qualisys; .yml or .json of OpenCV",
        options={"SKIP_SAVE"},
    )
    filter_glob: bpy.props.StringProperty(default=globbed(CALIBRATIONS), options={"HIDDEN"})
    resized: bpy.props.BoolProperty(
        name="Resized Footage",
        description="The footage was resized, uncropped, after calibrating: the cameras are scaled to its size",
        default=False,
        options={"SKIP_SAVE"},
    )

    def act(self, context: bpy.types.Context) -> None:
        from ...scene_io import added_views

        cameras = self.cameras_in(bpy.path.abspath(self.filepath))
        _report_calibrated(self, added_views.calibrate_views(context.scene, cameras, resized=self.resized))


def _has_calibrated_cameras(context: bpy.types.Context) -> str:
    own = {view.camera for view in context.scene.kfmocap.views}
    others = [owner for owner in context.scene.objects if owner.type == "CAMERA" and owner not in own]
    # Of the camera that each new file has nothing is known: NumPy is not loaded for it when the tab is drawn first.
    if any(tuple(owner.keys()) or owner.data.background_images for owner in others):
        from ...scene_io import added_views

        if added_views.spare_cameras(context.scene):
            return ""
    return "The scene has no calibrated camera that is not a view: calibrate, or import a calibration"


class UseSceneCameras(Conditional, bpy.types.Operator):
    """Assign the cameras that were calibrated in this scene to the views, by name: by wand, by Import Cameras or by
    Blender's own motion tracker. If there are no views, cameras with footage behind them become views"""

    bl_idname = "kfmocap.use_scene_cameras"
    bl_label = "Use Scene Cameras"
    conditions = (_has_calibrated_cameras,)

    def act(self, context: bpy.types.Context) -> None:
        from ...scene_io import added_views

        _report_calibrated(self, added_views.use_scene_cameras(context.scene))


class RemoveView(Conditional, bpy.types.Operator):
    """Remove this view from the shot, with its camera. The file stays where it is"""

    bl_idname = "kfmocap.remove_view"
    bl_label = "Remove View"
    conditions = (has_views,)

    view: bpy.props.IntProperty(
        default=-1, min=-1, name="View", description="Number of the view, from 0; -1: the one that is looked through"
    )

    def act(self, context: bpy.types.Context) -> None:
        from ...scene_io import added_views

        shot = context.scene.kfmocap
        index = self.view if self.view >= 0 else shot.shown_view
        if not 0 <= index < len(shot.views):
            raise ShotError("Look through the view first" if self.view < 0 else f"There is no view {index}")
        added_views.remove_view(context.scene, index)


def _report_calibrated(operator: bpy.types.Operator, calibrated: Calibrated) -> None:
    """Report which views were calibrated and which were not."""
    operator.report({"INFO"}, f"Calibrated {', '.join(calibrated.views)}")
    if calibrated.left:
        left, todo = ", ".join(calibrated.left), "name the view as its camera in Look Through > View, and do this again"
        operator.report({"WARNING"}, f"No camera goes by the name of {left}: {todo}")


CLASSES = (AddFootage, ImportCalibration, UseSceneCameras, RemoveView)
