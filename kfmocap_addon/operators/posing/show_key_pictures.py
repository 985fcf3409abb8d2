"""Showing pictures of the key poses, to see at a glance which of them fit."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

import bpy

from ....core.runtime.processes.worker_process import Work
from ...scene_io import active_performer
from ...scene_io.key_pictures import KeyPictures
from ...session import SESSION
from ..conditions import Conditional, has_footage, has_performer, has_shot, looks_through_view
from ..job_operator import JobOperator
from ..key_conditions import has_key_pose

if TYPE_CHECKING:
    from ....core.review.overlay import Image


class ShowKeyPictures(Conditional, JobOperator, bpy.types.Operator):
    """Show small pictures of the chosen performer's key poses, over the footage of the view that is looked through:
    proposals are accepted or refused below them. Esc cancels"""

    bl_idname = "kfmocap.show_key_pictures"
    bl_label = "Show Pictures"
    bl_options = {"REGISTER"}
    conditions = (has_shot, has_footage, has_performer, has_key_pose, looks_through_view)

    def prepare(self, context: bpy.types.Context) -> Work:
        """Read the shot, the poses and the frames to show."""
        from dataclasses import replace

        from ....core.errors import ShotError
        from ....core.review.overlay import picture_cells
        from ...scene_io import scene as scenes
        from ...scene_io import tracked_segments
        from ...scene_io.keys import key_pose_curves, motion_curves

        scene, slot = context.scene, active_performer.chosen(context)
        start, length = scene.kfmocap.frame_start, scene.kfmocap.length
        keyed, proposed = key_pose_curves.keyed_bones(slot.armature)
        self._frames = sorted(f for f in (*keyed, *proposed) if start <= f < start + length)
        if not self._frames:
            raise ShotError("there is no key pose to show", where=f"performer {slot.name}")
        self._armature = slot.armature
        shot = tracked_segments.with_footage_offset(scene, scenes.shot_from_scene(scene))
        number = list(scene.kfmocap.performers).index(slot)
        shown = replace(shot, views=(shot.views[scene.kfmocap.shown_view],), performers=(shot.performers[number],))
        motion = motion_curves.read_motion(slot.armature, start, length)
        return partial(picture_cells, shown, [motion], [frame - start for frame in self._frames])

    def finish(self, _context: bpy.types.Context, cells: list[Image]) -> None:
        """Show the pictures."""
        SESSION.of(KeyPictures).put(self._armature, dict(zip(self._frames, cells, strict=True)))


CLASSES = (ShowKeyPictures,)
