"""The pose that an armature shows now, keyed or not."""

from __future__ import annotations

from collections.abc import Collection, Sequence

import bpy
import numpy as np

from ....core.body.motion import Motion
from . import body_channels


def read_shown_pose(armature: bpy.types.Object) -> Motion:
    """Return the one pose that an armature shows now, keyed or not."""
    return pose_of_values(armature, shown_values(armature))


def pose_of_values(armature: bpy.types.Object, values: Sequence[float]) -> Motion:
    """Return the one pose of values of the body's channels."""
    return body_channels.motion_of_values(armature, np.array([values]))


def shown_values(armature: bpy.types.Object) -> list[float]:
    """Return the values of the body's channels as the armature shows them now."""
    bones = armature.pose.bones
    return [getattr(bones[c.bone], c.attribute)[c.index] for c in body_channels.list_channels(armature)]


def show_values(armature: bpy.types.Object, values: Sequence[float]) -> None:
    """Show values of the body's channels, without a key."""
    for channel, value in zip(body_channels.list_channels(armature), values, strict=True):
        getattr(armature.pose.bones[channel.bone], channel.attribute)[channel.index] = value


def show_pose(armature: bpy.types.Object, pose: Motion, bones: Collection[str] | None = None) -> None:
    """Show one pose, of these bones or the whole body, without a key.

    Quaternions keep the sign that they have, so that keys of them go with others.
    """
    [values], shown = body_channels.channel_values(armature, pose), shown_values(armature)
    q, before = (np.array(x[3:]).reshape(-1, 4) for x in (values, shown))
    signs = np.where(np.sum(q * before, axis=1, keepdims=True) < 0, -1.0, 1.0)
    wanted = [*values[:3], *(signs * q).ravel()]
    moved = [bones is None or channel.bone in bones for channel in body_channels.list_channels(armature)]
    show_values(armature, [a if m else b for a, b, m in zip(wanted, shown, moved, strict=True)])
