"""What a tracking tells of its own result, in the scene."""

from __future__ import annotations

from typing import TYPE_CHECKING

import bpy

from . import confidence, occlusion

if TYPE_CHECKING:
    from ..core.shot import Shot
    from ..core.tracking import TrackResult


def write_review(scene: bpy.types.Scene, shot: Shot, result: TrackResult) -> None:
    """Show in a scene what the cameras saw of its performers, how far they may be off, and where key poses would help.

    Parameters
    ----------
    shot : Shot
        As it was tracked.
    """
    occlusion.write_occlusion(scene, shot, result.visible)
    confidence.write_confidence(scene, shot, result.deviation)
