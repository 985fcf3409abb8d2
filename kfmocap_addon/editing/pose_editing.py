"""Key poses made of other poses: of another frame, of the body's other side, of the key poses beside."""

from __future__ import annotations

import json

import bpy
import numpy as np

from ...core.body.motion import Motion
from ...core.errors import BodyError, ShotError
from ...core.posing.depth import moved_in_depth
from ...core.posing.mirror import mirrored_poses
from ..scene_io.body import body_armature, body_channels, shown_pose
from ..scene_io.cameras import scene_cameras
from ..scene_io.keys import key_pose_curves, motion_curves


def set_pose(armature: bpy.types.Object, pose: Motion, frame: int, bones: set[str] | None) -> None:
    """Show a pose and key it on a scene frame: of these bones or the whole body."""
    shown_pose.show_pose(armature, pose, bones)
    key_pose_curves.key_current_pose(armature, frame, bones)


def beside(armature: bpy.types.Object, frame: int) -> tuple[Motion | None, Motion | None]:
    """Return the poses on the nearest frames before and after a scene frame that have a key pose."""
    keyed, _ = key_pose_curves.keyed_bones(armature)
    before = max((f for f in keyed if f < frame), default=None)
    after = min((f for f in keyed if f > frame), default=None)
    first, second = (None if f is None else motion_curves.read_motion(armature, f, 1) for f in (before, after))
    return first, second


def between(armature: bpy.types.Object, frame: int, share: float) -> Motion:
    """Return the pose at a share of the way from the key pose before a scene frame to that after it.

    Raises
    ------
    ShotError
        One of them is missing.
    """
    before, after = beside(armature, frame)
    if before is None or after is None:
        missing = "before" if before is None else "after"
        raise ShotError(f"there is no key pose {missing} it", where=f"frame {frame}", todo="set one first")
    return before.moved(share * before.difference(after))


def nudged(armature: bpy.types.Object, frame: int, earlier: bool, share: float) -> Motion:
    """Return the pose shown, moved a share of the way to the key pose before or after a scene frame.

    Raises
    ------
    ShotError
        There is none.
    """
    target = beside(armature, frame)[0 if earlier else 1]
    if target is None:
        where = "before" if earlier else "after"
        raise ShotError(f"there is no key pose {where} it", where=f"frame {frame}", todo="set one first")
    shown = shown_pose.read_shown_pose(armature)
    return shown.moved(share * shown.difference(target))


def nudged_in_depth(scene: bpy.types.Scene, armature: bpy.types.Object, distance: float) -> Motion:
    """Return the pose shown, moved away from the scene's camera, metres."""
    [camera] = scene_cameras.read_cameras(scene, [scene.camera], scene.frame_current, 1)
    return moved_in_depth(shown_pose.read_shown_pose(armature), camera.centre_world(), distance)


def mirrored(armature: bpy.types.Object, pose: Motion, root: bool) -> Motion:
    """Return a pose with left and right exchanged, bones paired by their names as Blender does."""
    body = body_armature.body_from_armature(armature)
    partners = []
    for name in body.names:
        other = bpy.utils.flip_name(name)
        partners.append(body.index(other) if other in body.names else body.index(name))
    return mirrored_poses(body, pose, partners, root)


def copied(armature: bpy.types.Object) -> str:
    """Return the pose shown, as text: the bones' own values by their names."""
    values: dict[str, dict[str, list[float]]] = {}
    for channel, value in zip(body_channels.list_channels(armature), shown_pose.shown_values(armature), strict=True):
        values.setdefault(channel.bone, {}).setdefault(channel.attribute, []).append(value)
    return json.dumps(values)


def pasted(armature: bpy.types.Object, text: str) -> Motion:
    """Return the pose shown, with the values of `copied` for the bones that it names.

    Raises
    ------
    BodyError
        No bone has such a name.
    """
    values = json.loads(text)
    channels, shown = body_channels.list_channels(armature), np.array(shown_pose.shown_values(armature))
    if not any(channel.bone in values for channel in channels):
        raise BodyError("no bone has the name of one of the copied pose", where=f"armature {armature.name}")
    for i, channel in enumerate(channels):
        if channel.attribute in values.get(channel.bone, {}):
            shown[i] = values[channel.bone][channel.attribute][channel.index]
    return shown_pose.pose_of_values(armature, shown.tolist())
