"""Parts that may be lost, in the scene: a list for each performer, with the frames."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import bpy

from ....core.evidence.occlusion import intervals
from ..body import body_armature

if TYPE_CHECKING:
    from ....core.tracking.expected_errors.uncertainty import JointErrors

WHOLE_BODY = "the whole body"
"""Listed where all of it may be lost, instead of its parts."""


def write_lost(
    scene: bpy.types.Scene,
    errors: Sequence[JointErrors],
    first: int = 0,
    *,
    slots: Sequence[bpy.types.PropertyGroup] | None = None,
) -> None:
    """List for a scene's performers which parts may be lost.

    Parameters
    ----------
    scene : bpy.types.Scene
    errors : sequence of JointErrors
        Of every performer on F frames.
    first : int
        Of an excerpt of the scene's shot: its first frame there. What is listed for other frames stays.
    slots : sequence of KFMocapPerformer, optional
        The performers; by default all of the scene's.
    """
    start = scene.kfmocap.frame_start + first
    for slot, own in zip(scene.kfmocap.performers if slots is None else slots, errors, strict=True):
        forget(slot, range(start, start + len(own.lost)))
        names = [bone.name for bone in body_armature.body_bones(slot.armature)]
        listed = [(WHOLE_BODY, own.body_maybe_lost()), *zip(names, own.parts_maybe_lost().T, strict=True)]
        for name, lost in listed:
            for frames in intervals(lost, start):
                item = slot.lost.add()
                item.name, item.frames = name, frames


def forget(slot: bpy.types.PropertyGroup, frames: Sequence[int]) -> None:
    """Remove from a performer's list what begins or ends on some scene frames."""
    gone = set(frames)
    for index in reversed(range(len(slot.lost))):
        if not gone.isdisjoint(slot.lost[index].frames):
            slot.lost.remove(index)
