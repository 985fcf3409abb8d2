"""Key poses from 2D keypoints of the views and from 3D landmarks."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import bpy

from ....core.runtime.processes.worker_process import Work
from ...scene_io import active_performer
from ..conditions import (
    Condition,
    Conditional,
    frame_is_in_shot,
    has_footage,
    has_keypoints,
    has_performer,
    has_shot,
    has_views,
)
from ..job_operator import JobOperator
from ..mixin import BesideFootage
from ..reporting import progress_shown, reported

if TYPE_CHECKING:
    from ....core.keypoints.proposals import KeypointPoses


class ImportKeypoints(Conditional, bpy.types.Operator, BesideFootage):
    """Give the views 2D keypoints of a detector: JSON of OpenPose, COCO, RTMPose and MMPose, AlphaPose, MediaPipe or
    YOLO, a file for each view or a folder with a file for each picture. They go to the view whose name is in the file's
    or folder's, else to the view that the scene looks through. One folder with those of all views will do"""

    bl_idname = "kfmocap.import_keypoints"
    bl_label = "Import Keypoints"
    conditions = (has_views,)

    filepath: bpy.props.StringProperty(subtype="FILE_PATH", options={"SKIP_SAVE"})
    directory: bpy.props.StringProperty(subtype="DIR_PATH", options={"SKIP_SAVE"})
    files: bpy.props.CollectionProperty(type=bpy.types.OperatorFileListElement, options={"SKIP_SAVE"})
    filter_glob: bpy.props.StringProperty(default="*.json", options={"HIDDEN"})

    def act(self, context: bpy.types.Context) -> None:
        from ...editing import keyframing

        folder = Path(bpy.path.abspath(self.directory or str(Path(self.filepath).parent)))
        names = [file.name for file in self.files if file.name]
        paths = [folder / name for name in names] or [Path(bpy.path.abspath(self.filepath or self.directory))]
        people = keyframing.attach_keypoints(context.scene, paths)
        self.report({"INFO"}, ", ".join(f"{view}: {count} poses" for view, count in people.items()))


class _FromKeypoints(Conditional):
    """A tool that needs a view with keypoints."""

    conditions: tuple[Condition, ...] = (has_shot, has_footage, has_performer, has_keypoints)


class MarkKeypoints(_FromKeypoints, bpy.types.Operator):
    """Mark the joints that the detector found on this frame, in all views, as if you had clicked them: Place Joints
    poses the body on them, and lets you correct them. Joints that are marked already stay"""

    bl_idname = "kfmocap.mark_keypoints"
    bl_label = "Mark Keypoints"
    conditions = (*_FromKeypoints.conditions, frame_is_in_shot())

    def act(self, context: bpy.types.Context) -> None:
        from ...editing import keyframing
        from ...viewports import viewport

        count = keyframing.mark_keypoints(context.scene, active_performer.chosen(context))
        self.report({"INFO"}, f"{count} joints are marked: pose the body on them with Place Joints")
        viewport.redraw(context)


class PoseFromKeypoints(_FromKeypoints, JobOperator, bpy.types.Operator):
    """Pose the chosen performer by the 2D keypoints of the views, on the frames chosen below. On proposed frames the
    poses are proposals, with the motion between them as a first pass: correct and accept them, or just track. On others
    they are key poses of yours. Depth is a guess where one view alone has keypoints and there is no key pose yet"""

    bl_idname = "kfmocap.pose_from_keypoints"
    bl_label = "Pose from Keypoints"

    def prepare(self, context: bpy.types.Context) -> Work:
        """Read the shot without the key poses that are to be replaced."""
        from ....core.tracking.prepare import pose_by_keypoint_files
        from ...editing import keyframing
        from ...scene_io import scene as scenes

        scene, self._slot = context.scene, active_performer.chosen(context).name
        frames = keyframing.frames_wanted(scene)
        number = scene.kfmocap.performers.find(self._slot)
        shot = keyframing.without_replaced(scene, scenes.shot_from_scene(scene), number, frames)
        return partial(pose_by_keypoint_files, shot, frames)

    def finish(self, context: bpy.types.Context, result: tuple[KeypointPoses, ...]) -> None:
        from ...editing import keyframing
        from ...scene_io import identities

        scene = context.scene
        number = scene.kfmocap.performers.find(self._slot)
        slot, seen = scene.kfmocap.performers[number], result[number]
        for other, found in zip(scene.kfmocap.performers, result, strict=True):
            identities.write_identity(other, found.identity)
        if scene.kfmocap.key_frames.choice == "AUTO":
            count = keyframing.propose(scene, slot, seen)
            self.report({"INFO"}, f"{count} key pose{' is' if count == 1 else 's are'} proposed")
        else:
            poses = seen.motion[seen.frames]
            _report_count(self, keyframing.set_key_poses(scene, slot, seen.frames.tolist(), poses), len(seen.frames))


class PoseFromLandmarks(Conditional, bpy.types.Operator, BesideFootage):
    """Pose the chosen performer by 3D landmarks, on the frames chosen in the panel: a TRC file as Pose2Sim and OpenSim
    write it, or a C3D file. The poses are key poses of yours"""

    bl_idname = "kfmocap.pose_from_landmarks"
    bl_label = "Pose from Landmarks"
    conditions = (has_performer,)

    filepath: bpy.props.StringProperty(subtype="FILE_PATH", name="Landmarks", description="TRC or C3D file")
    filter_glob: bpy.props.StringProperty(default="*.trc;*.c3d", options={"HIDDEN"})
    first_row: bpy.props.IntProperty(name="First Row", description="Row of the file, from 0, of the shot's first frame")
    up: bpy.props.EnumProperty(
        items=[
            ("auto", "As the File Says", "By its parameter POINT:Y_SCREEN; Z where it has none"),
            ("z", "Z", "The world as it is here"),
            ("y", "Y", "As TRC files are"),
        ],
        name="Up (C3D)",
        description="Which axis of a C3D file is up",
    )

    def execute(self, context: bpy.types.Context) -> set[str]:
        from ...editing import keyframing

        scene, slot, path = context.scene, active_performer.chosen(context), Path(bpy.path.abspath(self.filepath))
        with progress_shown(context), reported(self) as outcome:
            frames, poses = keyframing.landmark_poses(scene, slot, path, self.up, self.first_row)
            _report_count(self, keyframing.set_key_poses(scene, slot, frames, poses), len(frames))
        return outcome.value


def _report_count(operator: bpy.types.Operator, count: int, wanted: int) -> None:
    kept = f"; {wanted - count} frames keep your own" if count < wanted else ""
    operator.report({"INFO"} if count else {"WARNING"}, f"{count} key pose{' is' if count == 1 else 's are'} set{kept}")


CLASSES = (ImportKeypoints, MarkKeypoints, PoseFromKeypoints, PoseFromLandmarks)
