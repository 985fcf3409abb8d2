"""What keeps Blender from showing a body as its channels say, which is all that the tracker knows of its pose."""

from __future__ import annotations

from typing import Any

import bpy
import numpy as np

from ....core.body import Body, part_poses
from ....core.errors import listed
from .. import fcurves
from ..constraints import acts
from . import body_channels, shown_pose

_MAX_DISTANCE = 2e-3
"""Largest distance of a bone's head from where it should be, metres."""
_NAMED = 3


def disturbances(armature: bpy.types.Object, body: Body) -> list[str]:
    """Return what to report of an armature that shows another pose than its channels say, or shows them otherwise on
    other frames; `body` is the body that it was read as.
    """
    found = [_displaced(armature, body), *_muted_and_modified(armature), _driven(armature), _blended(armature)]
    return [text for text in found if text]


def _displaced(armature: bpy.types.Object, body: Body) -> str:
    """Return which bones are elsewhere on the frame that is shown than their rotations say, and why."""
    if armature.data.pose_position == "REST":
        return "it is shown in its rest position, without the motion: switch to Pose Position in its Data properties"
    evaluated = armature.evaluated_get(bpy.context.evaluated_depsgraph_get())
    heads = part_poses(body, shown_pose.read_shown_pose(armature))[1][0]
    shown = np.array([evaluated.matrix_world @ evaluated.pose.bones[name].head for name in body.names])
    off = np.linalg.norm(shown - heads, axis=1)
    if off.max() <= _MAX_DISTANCE:
        return ""
    bones = [armature.pose.bones[name] for name in body.names]
    causes = [cause for bone in bones if (cause := _cause(bone, moves=bone.name == body.names[0]))]
    why = f"by {listed(causes, _NAMED)}: the tracker does not know of it" if causes else "and tracking cannot see why"
    first = body.names[int(np.argmax(off > _MAX_DISTANCE))]
    return f"{first} is shown {1000 * off.max():.0f} mm from where its keys put it, {why}"


def _cause(bone: bpy.types.PoseBone, *, moves: bool) -> str:
    """Return what of a pose bone beside its channels moves it; `moves` is whether its location is a channel."""
    for held in list[Any](bone.constraints):
        if acts(held):
            return f"the constraint '{held.name}' of {bone.name}"
    if not np.allclose(np.array(bone.scale), 1.0, atol=1e-4):
        return f"the scale of {bone.name}"
    if bone.parent is not None and not bone.bone.use_inherit_rotation:
        return f"Inherit Rotation of {bone.name}, which is off"
    return f"the location of {bone.name}" if not moves and np.abs(np.array(bone.location)).max() > 1e-4 else ""


def _muted_and_modified(armature: bpy.types.Object) -> list[str]:
    """Return which of the body's curves are not shown, and which are changed by modifiers."""
    bag = fcurves.find_channelbag(armature)
    paths = {channel.path for channel in body_channels.list_channels(armature)}
    curves = [curve for curve in bag.fcurves if curve.data_path in paths] if bag is not None else []
    muted = _bones(curve for curve in curves if curve.mute)
    modified = _bones(curve for curve in curves if any(not m.mute and m.type != "CYCLES" for m in curve.modifiers))
    return [
        f"channels are muted, and what was tracked of them is not shown: {listed(muted, _NAMED)}" if muted else "",
        f"modifiers of curves change what was tracked: {listed(modified, _NAMED)}" if modified else "",
    ]


def _driven(armature: bpy.types.Object) -> str:
    """Return which of the body's channels have drivers, which Blender plays instead of keys."""
    paths = {channel.path for channel in body_channels.list_channels(armature)}
    drivers = armature.animation_data.drivers if armature.animation_data is not None else ()
    driven = _bones(driver for driver in drivers if driver.data_path in paths and not driver.mute)
    what = "drivers stand in the place of keys, and what was tracked there is not shown"
    return f"{what}: {listed(driven, _NAMED)}" if driven else ""


def _bones(curves: Any) -> list[str]:
    return sorted({fcurves.bone_of(curve.data_path) for curve in curves})


def _blended(armature: bpy.types.Object) -> str:
    """Return how the NLA changes what the armature's own action says."""
    data = armature.animation_data
    if data is None or not data.use_nla or not any(track.strips for track in data.nla_tracks):
        return ""
    if any(track.is_solo for track in data.nla_tracks):
        return "a track of the NLA is played alone, so the motion is not shown: end its Solo"
    if data.action_blend_type != "REPLACE" or data.action_influence < 1.0:
        return "its action is blended with strips of the NLA: set it to Replace with the influence 1"
    return ""
