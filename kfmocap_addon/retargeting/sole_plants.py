"""When the feet of a performer are planted, in the scene: found in the motion, corrected by the animator."""

from __future__ import annotations

from collections.abc import Collection

import bpy
import numpy as np

from ...core.body.foot_plants import runs
from ...core.errors import BodyError
from ...core.numerics.arrays import Bools
from ...core.retargeting.foot_clean_up import with_clean_feet
from ...core.retargeting.foot_keeping import foot_paths
from ...core.retargeting.retarget import prepared
from ..scene_io import body_armature, bone_confidence, bone_visibility, key_pose_curves, motion_curves
from ..scene_io.scene import frame_rate
from .source_motion import motion_of_performer


def find(scene: bpy.types.Scene, slot: bpy.types.PropertyGroup) -> None:
    """Find when heel and ball of a performer's feet are planted; what the animator has set stays.

    Frames on which the tracker is unsure decide less.

    Raises
    ------
    BodyError
        The body is no human's.
    ShotError
        There is no motion.
    """
    source, bones = prepared(motion_of_performer(scene, slot))
    deviation = bone_confidence.read_confidence(slot.armature, scene.kfmocap.frame_start, len(source))
    flags: dict[str, Bools] = {}
    for path in foot_paths(source, bones, deviation):
        for c, point in enumerate(("heel", "ball")):
            flags[f"{point}.{path.side}"] = path.planted[:, c]
    for edit in slot.plant_edits:
        if edit.name in flags:
            _set(flags[edit.name], edit, scene.kfmocap.frame_start, edit.planted)
    _show(scene, slot, flags)


def refresh(scene: bpy.types.Scene) -> None:
    """Find the plants of all performers that were tracked; bodies without feet have none."""
    for slot in scene.kfmocap.performers:
        if bone_visibility.is_tracked(slot.armature):
            try:
                find(scene, slot)
            except BodyError:
                slot.plants.clear()
                slot.plants_found = ""


def shown(scene: bpy.types.Scene, slot: bpy.types.PropertyGroup) -> dict[str, Bools] | None:
    """Return when points of the soles are planted on the frames of the shot; None where nobody has looked yet."""
    if not slot.plants_found:
        return None
    points = slot.plants_found.split()
    flags = {name: np.zeros(max(scene.kfmocap.length, 0), bool) for name in points}
    for plant in slot.plants:
        _set(flags[plant.name], plant, scene.kfmocap.frame_start, True)
    return flags


def edit(
    scene: bpy.types.Scene,
    slot: bpy.types.PropertyGroup,
    points: Collection[str],
    frames: tuple[int, int],
    planted: bool,
) -> None:
    """Say that points of the soles are planted, or not, from one scene frame to another.

    Raises
    ------
    BodyError, ShotError
        As `find`, where it was not looked for plants yet.
    """
    first, last = min(frames), max(frames)
    if not slot.plants_found:
        find(scene, slot)
    flags = shown(scene, slot) or {}
    for name in points:
        if name not in flags:
            continue
        for k in reversed(range(len(slot.plant_edits))):
            old = slot.plant_edits[k]
            if old.name == name and first <= old.first and old.last <= last:
                slot.plant_edits.remove(k)
        new = slot.plant_edits.add()
        new.name, new.first, new.last, new.planted = name, first, last, planted
        _set(flags[name], new, scene.kfmocap.frame_start, planted)
    _show(scene, slot, flags)


def clean_feet(scene: bpy.types.Scene, slot: bpy.types.PropertyGroup) -> None:
    """Make planted feet of a tracked motion stand still; the animator's keys stay.

    Raises
    ------
    BodyError, ShotError
        As `find`.
    """
    if not slot.plants_found:
        find(scene, slot)
    armature, start, length = slot.armature, scene.kfmocap.frame_start, scene.kfmocap.length
    body = body_armature.body_from_armature(armature)
    motion = motion_curves.read_motion(armature, start, length)
    keys = key_pose_curves.read_key_poses(armature, start, length)
    cleaned = with_clean_feet(body, motion, frame_rate(scene), keys, shown(scene, slot))
    motion_curves.write_motion(armature, cleaned, start)


def _set(flags: Bools, plant: bpy.types.PropertyGroup, start: int, value: bool) -> None:
    flags[max(plant.first - start, 0) : max(plant.last - start + 1, 0)] = value


def _show(scene: bpy.types.Scene, slot: bpy.types.PropertyGroup, flags: dict[str, Bools]) -> None:
    slot.plants.clear()
    slot.plants_found = " ".join(flags)
    for name, planted in flags.items():
        for first, last in runs(planted):
            plant = slot.plants.add()
            plant.name = name
            plant.first, plant.last = scene.kfmocap.frame_start + first, scene.kfmocap.frame_start + last
