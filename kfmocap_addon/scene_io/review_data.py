"""What a tracking reports about its own result, in the scene."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import bpy

from . import bone_confidence, bone_visibility, unknown_bones
from .identities import write_identity

if TYPE_CHECKING:
    from ...core.shot.shot import Shot
    from ...core.tracking.track_result import TrackResult


def write_review(scene: bpy.types.Scene, tracked: Sequence[tuple[Shot, TrackResult, int]]) -> None:
    """Show in a scene what the cameras saw of its performers, how far they may be off, and where key poses would help.

    Parameters
    ----------
    tracked : sequence of (Shot, TrackResult, int)
        Excerpts of the scene's shot as they were tracked, or all of it, each with its first frame there. Other frames
        keep what was written for them.
    """
    for shot, result, first in tracked:
        bone_visibility.write_occlusion(scene, shot, result.visible, first)
        bone_confidence.write_confidence(scene, result.deviation, first)
        for slot, own in zip(scene.kfmocap.performers, result.observed.performers, strict=False):
            write_identity(slot, own.identity)
        if shot.length == scene.kfmocap.length:
            for slot, names in zip(scene.kfmocap.performers, result.unknown, strict=True):
                unknown_bones.mark_unseen(slot.armature, names)
    bone_confidence.refresh(scene)
