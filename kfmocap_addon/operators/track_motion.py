"""Tracking: the frames between the key poses, from the footage; all of them, or some stretches."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

import bpy

from ..jobs.job import Work
from .job_operator import JobOperator
from .reporting import explained, reported

if TYPE_CHECKING:
    from collections.abc import Sequence

    from ...core.shot.shot import Shot
    from ...core.tracking.segments import Segment
    from ...core.tracking.track_result import TrackResult


class Tracking(JobOperator):
    """Track some of the stretches between key poses. What lies beside them stays as it is."""

    bl_options = {"REGISTER", "UNDO"}

    def chosen(self, scene: bpy.types.Scene, shot: Shot) -> Sequence[Segment]:
        """The stretches of the scene's shot to track."""
        raise NotImplementedError

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        if not explained(cls, context):
            return False
        if all(_is_animated(slot.armature) for slot in context.scene.kfmocap.performers):
            return True
        cls.poll_message_set("A performer has no key pose yet: pose it on a frame, and use Set Key Pose")
        return False

    def prepared(self, context: bpy.types.Context) -> Work:
        from ...core.errors import ShotError
        from ...core.tracking.retracking import track_excerpts
        from ..scene_io import scene as scenes
        from ..scene_io import tracked_segments

        shot = scenes.shot_from_scene(context.scene)
        chosen = self.chosen(context.scene, shot)
        if not chosen:
            raise ShotError("there is nothing to track", where=self.bl_label)
        parts = tracked_segments.excerpts(context.scene, shot, chosen)
        self._asked = context.scene.name, shot, parts
        return partial(track_excerpts, shot, parts)

    def finish(self, _context: bpy.types.Context, results: Sequence[TrackResult]) -> None:
        from ...core.errors import ShotError
        from ..scene_io import tracked_segments

        name, shot, parts = self._asked
        scene = bpy.data.scenes.get(name)
        if scene is None:
            raise ShotError("the scene is gone", where=f"scene {name}")
        tracked_segments.write(scene, shot, parts, results)
        frames = sum(part.last + 1 - part.first for part in parts)
        seconds = sum(sum(result.seconds.values()) for result in results)
        self.report({"INFO"}, f"Tracked {frames} frames in {seconds:.1f} s")


class TrackAll(Tracking, bpy.types.Operator):
    """Fill in every frame between the key poses from the footage. Keys you set stay as they are; those of an
    earlier tracking are replaced. Esc cancels"""

    bl_idname = "kfmocap.track"
    bl_label = "Track All"

    def chosen(self, _scene: bpy.types.Scene, shot: Shot) -> Sequence[Segment]:
        from ...core.tracking.segments import segments

        return segments(shot)


class TrackChanges(Tracking, bpy.types.Operator):
    """Track the stretches that were never tracked, and those for which a key pose, a camera or a setting has changed
    since: after a correcting key pose, the two beside it. Esc cancels"""

    bl_idname = "kfmocap.track_changes"
    bl_label = "Track Changes"

    def chosen(self, scene: bpy.types.Scene, shot: Shot) -> Sequence[Segment]:
        from ...core.errors import ShotError
        from ..scene_io import tracked_segments

        found = tracked_segments.out_of_date(scene, shot)
        if not found:
            raise ShotError("nothing has changed since it was tracked", todo="use Track All to track it again anyway")
        return found


class TrackHere(Tracking, bpy.types.Operator):
    """Track from the key pose before this frame to the one after it; on a key pose, both sides of it. Esc cancels"""

    bl_idname = "kfmocap.track_here"
    bl_label = "Track Here"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return super().poll(context) and _frame_is_in(cls, context, 0, 0)

    def chosen(self, scene: bpy.types.Scene, shot: Shot) -> Sequence[Segment]:
        from ...core.tracking.retracking import stretches_at
        from ...core.tracking.segments import segments

        return stretches_at(segments(shot), _shot_frame(scene))


class TrackForward(Tracking, bpy.types.Operator):
    """Track from the key pose at or before this frame to the end of the shot. Esc cancels"""

    bl_idname = "kfmocap.track_forward"
    bl_label = "Track Forward"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return super().poll(context) and _frame_is_in(cls, context, 0, -1)

    def chosen(self, scene: bpy.types.Scene, shot: Shot) -> Sequence[Segment]:
        from ...core.tracking.retracking import stretches_after
        from ...core.tracking.segments import segments

        return stretches_after(segments(shot), _shot_frame(scene))


class TrackBackward(Tracking, bpy.types.Operator):
    """Track from the key pose at or after this frame to the beginning of the shot. Esc cancels"""

    bl_idname = "kfmocap.track_backward"
    bl_label = "Track Backward"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return super().poll(context) and _frame_is_in(cls, context, 1, 0)

    def chosen(self, scene: bpy.types.Scene, shot: Shot) -> Sequence[Segment]:
        from ...core.tracking.retracking import stretches_before
        from ...core.tracking.segments import segments

        return stretches_before(segments(shot), _shot_frame(scene))


class ClearBetween(bpy.types.Operator):
    """Remove tracked keys; those you set stay as they are"""

    bl_idname = "kfmocap.clear_between"
    bl_label = "Clear Between"
    bl_options = {"REGISTER", "UNDO"}

    where: bpy.props.EnumProperty(
        items=[
            ("HERE", "Here", "Between the key poses around this frame; on a key pose, on both sides of it"),
            ("EVERYWHERE", "Everywhere", "On all frames of the shot"),
        ],
        name="Where",
        description="Which tracked keys to remove",
    )

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return explained(cls, context)

    @classmethod
    def description(cls, _context: bpy.types.Context, properties: bpy.types.OperatorProperties) -> str:
        place = cls.bl_rna.properties["where"].enum_items[properties.where].description
        return f"{cls.__doc__}. {place}"

    def execute(self, context: bpy.types.Context) -> set[str]:
        from ...core.errors import ShotError
        from ...core.tracking.retracking import stretches_at
        from ...core.tracking.segments import segments
        from ..scene_io import scene as scenes
        from ..scene_io import tracked_segments

        with reported(self) as outcome:
            shot = scenes.shot_from_scene(context.scene, footage=False)
            chosen = segments(shot)
            if self.where == "HERE":
                chosen = stretches_at(chosen, _shot_frame(context.scene))
            cleared = tracked_segments.clear(context.scene, shot, chosen)
            if not cleared:
                raise ShotError("there are no tracked keys to remove", where=self.bl_label)
            self.report({"INFO"}, f"Removed tracked keys of {cleared} frames")
        return outcome.value


def _is_animated(armature: bpy.types.Object | None) -> bool:
    return armature is not None and armature.animation_data is not None and armature.animation_data.action is not None


def _shot_frame(scene: bpy.types.Scene) -> int:
    return scene.frame_current - scene.kfmocap.frame_start


def _frame_is_in(operator: type[bpy.types.Operator], context: bpy.types.Context, inner: int, outer: int) -> bool:
    """Whether the current frame is one of the shot's, from its first + `inner` to its last + `outer`."""
    if inner <= _shot_frame(context.scene) < context.scene.kfmocap.length + outer:
        return True
    operator.poll_message_set("There is no frame of the shot on that side of this one, or this is none of its frames")
    return False


CLASSES = (TrackAll, TrackChanges, TrackHere, TrackForward, TrackBackward, ClearBetween)
