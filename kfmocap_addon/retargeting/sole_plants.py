"""Detecting plants in a performer's motion, and cleaning up the feet accordingly."""

from __future__ import annotations

from collections.abc import Sequence

import bpy

from ...core.body import Body
from ...core.errors import BodyError
from ...core.numerics.arrays import Bools
from ...core.retargeting.contacts.foot_paths import foot_paths
from ...core.retargeting.foot_clean_up import with_clean_feet
from ...core.retargeting.retarget import prepared
from ..scene_io.body import body_armature
from ..scene_io.keys import key_pose_curves, motion_curves
from ..scene_io.review import bone_confidence, bone_visibility, plant_lists
from ..scene_io.scene import frame_rate
from .source_motion import motion_of_performer


def find(scene: bpy.types.Scene, slot: bpy.types.PropertyGroup, body: Body | None = None) -> None:
    """Detect when heel and ball of a performer's feet are planted; tested plants and the animator's corrections stay.
    `body` is the performer's, if it has been read already.

    Raises
    ------
    BodyError
        The body is not human.
    ShotError
        There is no motion.
    """
    plant_lists.show(scene, slot, _seeming(scene, slot, body))


def refresh(scene: bpy.types.Scene, bodies: Sequence[Body]) -> None:
    """Find the plants of all performers that were tracked, who have these bodies; those without feet have none."""
    for slot, body in zip(scene.kfmocap.performers, bodies, strict=True):
        if bone_visibility.is_tracked(slot.armature):
            try:
                find(scene, slot, body)
            except BodyError:
                slot.plants.clear()
                slot.plants_found = ""


def on_ground(scene: bpy.types.Scene, slot: bpy.types.PropertyGroup) -> dict[str, Bools] | None:
    """Return on which frames of the shot points of the soles are on the ground: when they are planted, and when they
    seem planted although the footage shows them creep, unless the animator has corrected that: by point, shape (F,).
    None before plants have been found.

    Raises
    ------
    BodyError, ShotError
        As `find`.
    """
    stand = plant_lists.shown(scene, slot)
    if stand is None:
        return None
    either = {name: stand[name] | seems for name, seems in _seeming(scene, slot).items() if name in stand}
    return plant_lists.with_edits(scene, slot, stand | either)


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
    cleaned = with_clean_feet(body, motion, frame_rate(scene), keys, plant_lists.shown(scene, slot))
    motion_curves.write_motion(armature, cleaned, start)


def _seeming(scene: bpy.types.Scene, slot: bpy.types.PropertyGroup, body: Body | None = None) -> dict[str, Bools]:
    """Return when points of the soles seem planted in the motion; frames with large expected errors have less
    weight.
    """
    source, bones = prepared(motion_of_performer(scene, slot, body))
    deviation = bone_confidence.read_confidence(slot.armature, scene.kfmocap.frame_start, len(source))
    return {
        f"{point}.{path.side}": path.planted[:, c]
        for path in foot_paths(source, bones, deviation)
        for c, point in enumerate(("heel", "ball"))
    }
