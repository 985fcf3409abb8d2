"""What a tracking tells of its own result, in the scene."""

from __future__ import annotations

from typing import TYPE_CHECKING

import bpy

from . import confidence, occlusion

if TYPE_CHECKING:
    from ..core.shot import Shot
    from ..core.tracking import TrackResult


def write_review(scene: bpy.types.Scene, shot: Shot, result: TrackResult, first: int = 0) -> None:
    """Show in a scene what the cameras saw of its performers, how far they may be off, and where key poses would help.

    Parameters
    ----------
    shot : Shot
        As it was tracked.
    result : TrackResult
    first : int
        Of an excerpt of the scene's shot: its first frame there. What is told of other frames stays.
    """
    occlusion.write_occlusion(scene, shot, result.visible, first)
    confidence.write_confidence(scene, shot, result.deviation, first)
