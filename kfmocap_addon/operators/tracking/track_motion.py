"""Tracking: filling in the frames between key poses from the footage, in all segments or some."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any

import bpy

from ....core.runtime.processes.worker_process import Work
from ...scene_io import active_performer, playback, unfinished_tracking
from ...viewports.changed_segments import known_changes
from ..conditions import (
    Condition,
    Conditional,
    frame_is_in_shot,
    has_footage,
    has_shot,
    has_tracked,
    pushed_down,
    shot_frame,
)
from ..job_operator import JobOperator
from ..key_conditions import has_tracked_keys

if TYPE_CHECKING:
    from collections.abc import Sequence

    from ....core.fitting.shot_cameras import CheckedTrack
    from ....core.shot.segments import Segment
    from ....core.shot.shot import Shot
    from ...scene_io.keys.tracking_preview import TrackingPreview
    from ...scene_io.tracked_segments import AskedTracking


def _has_key_poses(context: bpy.types.Context) -> str:
    slots = context.scene.kfmocap.performers
    if _tracks_one(context):
        slot = active_performer.chosen(context)
        missing = slot is None or not _is_animated(slot.armature)
        name = slot.name if slot else "Nobody"
        return f"{name} has no key pose yet: pose it on a frame, or choose another performer" if missing else ""
    unkeyed = next((slot for slot in slots if not _is_animated(slot.armature)), None)
    if unkeyed is None:
        return ""
    if playback.unreachable_keys(unkeyed.armature):
        return pushed_down(unkeyed)
    others = ", or track the others by Chosen Only" if len(slots) > 1 else ""
    return f"{unkeyed.name} has no key pose yet: pose it on a frame with Place Joints, or use Set Key Pose{others}"


def _tracks_one(context: bpy.types.Context) -> bool:
    """Return whether only the chosen performer is tracked."""
    properties = context.scene.kfmocap
    return len(properties.performers) > 1 and properties.tracked == "CHOSEN"


class Tracking(Conditional, JobOperator):
    """Track some of the segments between key poses; other frames are not changed.

    Attributes
    ----------
    side : str
        Which segments: EVERYWHERE, or relative to the current frame HERE, FORWARD or BACKWARD.
    resume : bool
        Whether to reuse the finished segments of a tracking that was stopped.
    anew : bool
        Whether to ignore the motion that the segments have already.
    """

    conditions: tuple[Condition, ...] = (has_shot, has_footage, _has_key_poses)
    side = "EVERYWHERE"
    resume = False
    anew = True

    def segments(self, scene: bpy.types.Scene, asked: AskedTracking) -> Sequence[Segment]:
        """Choose the segments of the scene's shot to track."""
        return _segments_on_side(scene, asked.shot, self.side)

    def prepare(self, context: bpy.types.Context) -> Work:
        """Read the shot and choose what to track."""
        from ....core.errors import ShotError
        from ....core.fitting.shot_cameras import track_and_check
        from ....core.runtime.processes.worker_memory import CachingTask
        from ...scene_io import scene as scenes
        from ...scene_io import tracked_segments

        one = active_performer.chosen(context) if _tracks_one(context) else None
        asked = tracked_segments.asked_tracking(context.scene, scenes.shot_from_scene(context.scene), one)
        self._disturbances = _disturbances_of(context.scene, asked)
        chosen = self.segments(context.scene, asked)
        if not chosen:
            raise ShotError("there is nothing to track", where=self.bl_label)
        parts = tracked_segments.excerpts(context.scene, asked, chosen, anew=self.anew)
        self._asked = context.scene.name, asked, parts
        self._preview: TrackingPreview | None = None
        journal = unfinished_tracking.begun(context.scene, chosen, resume=self.resume)
        here = shot_frame(context.scene)
        return CachingTask(partial(track_and_check, asked.shot, parts, journal=journal, looking_at=here), shows=True)

    def kept(self, context: bpy.types.Context) -> str:
        """Return a message on how many segments were finished."""
        count = unfinished_tracking.segment_count(context.scene)
        return f". Continue goes on from {count} finished segment{'s' if count > 1 else ''}" if count else ""

    def show(self, _context: bpy.types.Context, shown: dict[Any, Any]) -> None:
        """Show the frames tracked so far, and which footage does not match the key poses."""
        from ....core.fitting.checks.early_check import EARLY_MISFITS
        from ...scene_io.cameras import view_cameras
        from ...scene_io.keys.tracking_preview import TrackingPreview

        scene: bpy.types.Scene | None = bpy.data.scenes.get(self._asked[0])
        misfits = shown.pop(EARLY_MISFITS, ())
        if scene is not None and misfits:
            view_cameras.show_fits(scene.kfmocap.views, misfits)
        if scene is not None and shown:
            self._preview = self._preview or TrackingPreview(scene, self._asked[1].slots)
            self._preview.show(shown)

    def hide(self, _context: bpy.types.Context) -> None:
        """Remove the preview: the result is written as a whole, or not at all."""
        if self._preview is not None:
            self._preview.end()
            self._preview = None

    def finish(self, _context: bpy.types.Context, tracked: CheckedTrack) -> None:
        """Write the tracked motion into the scene, and report cameras that do not fit and footage that is damaged."""
        from ....core.errors import ShotError
        from ...retargeting import sole_plants
        from ...scene_io import tracked_segments
        from ...scene_io.cameras import view_cameras
        from ...scene_io.review import faulty_footage

        name, asked, parts = self._asked
        shot = asked.whole
        scene: bpy.types.Scene | None = bpy.data.scenes.get(name)
        if scene is None:
            raise ShotError("the scene is gone", where=f"scene {name}")
        for slot, texts in self._disturbances:
            slot.disturbances = "\n".join(texts)
            for text in texts:
                self.report({"WARNING"}, f"{slot.name}: {text}")
        results = tracked.results
        whole = tracked_segments.write(scene, asked, parts, results, unwatched=not self.blocks)
        sole_plants.refresh(scene, [performer.body for performer in whole.performers])
        unfinished_tracking.discard(scene)
        if tracked.fits is not None:
            for line in view_cameras.show_fits(scene.kfmocap.views, tracked.fits):
                self.report({"WARNING"}, line)
        for text in faulty_footage.show_faults(scene, shot, parts, results):
            self.report({"WARNING"}, text)
        frames = sum(part.last + 1 - part.first for part in parts)
        seconds = sum(sum(result.seconds.values()) for result in results)
        self.report({"INFO"}, f"Tracked {frames} frames in {seconds:.1f} s")


class TrackAll(Tracking, bpy.types.Operator):
    """Fill in every frame between the key poses from the footage. Keys you set stay as they are; those of an
    earlier tracking are replaced. Esc cancels"""

    bl_idname = "kfmocap.track"
    bl_label = "Track All"


def _something_changed(context: bpy.types.Context) -> str:
    if known_changes().known(context.scene) is not False:
        return ""
    return "Nothing has changed since it was tracked: use Track All to track it again anyway"


class TrackChanges(Tracking, bpy.types.Operator):
    """Track the segments that were never tracked, and those for which a key pose, a camera or a setting has changed
    since: after a correcting key pose, the two beside it. Esc cancels"""

    bl_idname = "kfmocap.track_changes"
    bl_label = "Track Changes"
    conditions = (*Tracking.conditions, _something_changed)
    anew = False

    def segments(self, scene: bpy.types.Scene, asked: AskedTracking) -> Sequence[Segment]:
        """Choose the segments for which a key pose, a camera or a setting has changed."""
        from ....core.errors import ShotError
        from ...scene_io import tracked_segments

        found = tracked_segments.out_of_date(scene, asked.whole)
        if not found:
            raise ShotError("nothing has changed since it was tracked", todo="use Track All to track it again anyway")
        return found


def _was_ended(context: bpy.types.Context) -> str:
    return "" if unfinished_tracking.segment_count(context.scene) else "No tracking of this scene was stopped"


class ContinueTracking(Tracking, bpy.types.Operator):
    """Continue a tracking that was stopped, by Esc or by closing Blender: segments that it had finished are not tracked
    again, unless something has changed since. Esc cancels"""

    bl_idname = "kfmocap.continue_tracking"
    bl_label = "Continue Tracking"
    conditions = (*Tracking.conditions, _was_ended)
    resume = True

    def segments(self, scene: bpy.types.Scene, asked: AskedTracking) -> Sequence[Segment]:
        """Choose the segments that were requested then, if they still exist."""
        from ....core.shot.segments import segments

        before, every = unfinished_tracking.asked_segments(scene), segments(asked.shot)
        return [segment for segment in every if segment in before] or every


class TrackHere(Tracking, bpy.types.Operator):
    """Track from the key pose before this frame to the one after it; on a key pose, both sides of it. Esc cancels"""

    bl_idname = "kfmocap.track_here"
    bl_label = "Track Around This Frame"
    conditions = (*Tracking.conditions, frame_is_in_shot())
    side = "HERE"


class TrackForward(Tracking, bpy.types.Operator):
    """Track from the key pose at or before this frame to the end of the shot. Esc cancels"""

    bl_idname = "kfmocap.track_forward"
    bl_label = "Track Forward"
    conditions = (*Tracking.conditions, frame_is_in_shot(last=-1))
    side = "FORWARD"


class TrackBackward(Tracking, bpy.types.Operator):
    """Track from the key pose at or after this frame to the beginning of the shot. Esc cancels"""

    bl_idname = "kfmocap.track_backward"
    bl_label = "Track Backward"
    conditions = (*Tracking.conditions, frame_is_in_shot(first=1))
    side = "BACKWARD"


class ClearBetween(Conditional, bpy.types.Operator):
    """Remove tracked keys; those you set stay as they are"""

    bl_idname = "kfmocap.clear_between"
    bl_label = "Clear Between"
    conditions: tuple[Condition, ...] = (has_shot, has_tracked, has_tracked_keys)

    where: bpy.props.EnumProperty(
        items=[
            ("HERE", "Here", "Between the key poses around this frame; on a key pose, on both sides of it"),
            ("EVERYWHERE", "Everywhere", "On all frames of the shot"),
        ],
        name="Where",
        description="Which tracked keys to remove",
    )

    @classmethod
    def description(cls, _context: bpy.types.Context, properties: bpy.types.OperatorProperties) -> str:
        place = cls.bl_rna.properties["where"].enum_items[properties.where].description
        return f"{cls.__doc__}. {place}"

    def act(self, context: bpy.types.Context) -> None:
        from ....core.errors import ShotError
        from ...scene_io import scene as scenes
        from ...scene_io import tracked_segments

        shot = scenes.shot_from_scene(context.scene, footage=False)
        cleared = tracked_segments.clear(context.scene, _segments_on_side(context.scene, shot, self.where))
        if not cleared:
            raise ShotError("there are no tracked keys to remove", where=self.bl_label)
        self.report({"INFO"}, f"Removed tracked keys of {cleared} frames")


def _disturbances_of(scene: bpy.types.Scene, asked: AskedTracking) -> list[tuple[bpy.types.PropertyGroup, list[str]]]:
    """Return what to report of each performer that is shown otherwise than its keys say, or has too few of them.

    Raises
    ------
    BodyError
        The armature of one is moved as a whole.
    """
    from ....core.review.pretracking_warnings import unposed_text
    from ...retargeting.tracked_bodies.tracked_bones import refuse_moving_object
    from ...scene_io.body.disturbances import disturbances

    for slot in asked.slots.values():
        refuse_moving_object(scene, slot.armature)
    found = []
    for number, slot in asked.slots.items():
        performer = asked.shot.performers[number]
        texts = [*disturbances(slot.armature, performer.body), unposed_text(performer)]
        found.append((slot, [text for text in texts if text]))
    return found


def _is_animated(armature: bpy.types.Object | None) -> bool:
    return armature is not None and armature.animation_data is not None and armature.animation_data.action is not None


def _segments_on_side(scene: bpy.types.Scene, shot: Shot, side: str) -> Sequence[Segment]:
    from ....core.shot.segments import segments
    from ....core.tracking.retracking import segments_after, segments_at, segments_before

    every, frame = segments(shot), shot_frame(scene)
    if side == "HERE":
        return segments_at(every, frame)
    if side == "FORWARD":
        return segments_after(every, frame)
    return segments_before(every, frame) if side == "BACKWARD" else every


CLASSES = (TrackAll, TrackChanges, ContinueTracking, TrackHere, TrackForward, TrackBackward, ClearBetween)
