"""What a tracking reports about its own result, in the scene."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import bpy

from ..identities import write_identity
from . import bone_confidence, bone_visibility, lost_parts, plant_lists, unknown_bones

if TYPE_CHECKING:
    from ....core.shot.shot import Shot
    from ....core.tracking.results.track_result import TrackResult


def write_review(
    scene: bpy.types.Scene,
    tracked: Sequence[tuple[Shot, TrackResult, int]],
    *,
    slots: Mapping[int, bpy.types.PropertyGroup] | None = None,
    whole: Shot | None = None,
) -> None:
    """Show in a scene what the cameras saw of its performers, how far they may be off, and where key poses would help.

    Parameters
    ----------
    tracked : sequence of (Shot, TrackResult, int)
        Excerpts of the scene's shot as they were tracked, or all of it, each with its first frame there. Other frames
        keep what was written for them.
    slots : mapping of int to KFMocapPerformer, optional
        Those of whom it is shown, by their numbers among the performers of the shots; by default all of the scene's.
    whole : Shot, optional
        The scene's shot as it stands, if it has been read already.
    """
    slots = dict(enumerate(scene.kfmocap.performers)) if slots is None else slots
    numbers, chosen = list(slots), list(slots.values())
    for shot, result, first in tracked:
        frames = range(scene.kfmocap.frame_start + first, scene.kfmocap.frame_start + first + shot.length)
        own = replace(shot, performers=tuple(shot.performers[i] for i in numbers))
        bone_visibility.write_occlusion(scene, own, [result.visible[i] for i in numbers], first, slots=chosen)
        bone_confidence.write_confidence(scene, [result.deviation[i] for i in numbers], first, slots=chosen)
        lost_parts.write_lost(scene, [result.errors[i] for i in numbers], first, slots=chosen)
        for i, slot in slots.items():
            planted = result.planted[i] if result.planted else None
            plant_lists.write_tested(scene, slot, shot.performers[i].body, planted, frames)
            if i < len(result.observed.performers):
                write_identity(slot, result.observed.performers[i].identity)
            if shot.length == scene.kfmocap.length:
                unknown_bones.mark_unseen(slot.armature, result.unknown[i])
    bone_confidence.refresh(scene, whole)
