"""What moves an armature object as a whole: its parent, a constraint, a driver, or keys of its own."""

from __future__ import annotations

from typing import Any

import bpy
import numpy as np

from .. import fcurves
from ..constraints import acts
from ..visited_frames import same_time_and_poses

_STILL_TOLERANCE = 1e-4
"""Largest change of the object's matrix, metres or radians, of one that stays."""
_MOVING = ("location", "rotation", "scale", "delta_")
"""How the data paths of what moves an object begin."""
_SAMPLE = 7
"""Frames on which it is looked for."""


def what_moves(scene: bpy.types.Scene, armature: bpy.types.Object, frames: tuple[int, int]) -> str | None:
    """Return what moves an armature object between two scene frames, None where nothing does."""
    holds = [held for held in list[Any](armature.constraints) if acts(held)]
    if armature.parent is None and not holds and not _is_keyed(armature):
        return None
    layer, places = scene.view_layers[0], []
    with same_time_and_poses(scene):
        for frame in np.unique(np.linspace(*frames, _SAMPLE).astype(int)):
            scene.frame_set(int(frame))
            places.append(np.array(armature.evaluated_get(layer.depsgraph).matrix_world))
    if np.ptp(places, axis=0).max() < _STILL_TOLERANCE:
        return None
    if armature.parent is not None:
        return f"its parent {armature.parent.name}"
    return f"its constraint '{holds[0].name}'" if holds else "its own keys"


def _is_keyed(armature: bpy.types.Object) -> bool:
    """Whether curves or drivers move the armature object, and not only its bones."""
    data = armature.animation_data
    paths = fcurves.animated_paths(armature) | {driver.data_path for driver in data.drivers} if data else set()
    return any(path.startswith(_MOVING) for path in paths)
