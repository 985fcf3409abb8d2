"""The animator's keys as key poses, and key poses as keys."""

from __future__ import annotations

from collections.abc import Collection

import bpy
import numpy as np
from numpy.typing import NDArray

from ....core.body.motion import Motion
from ....core.numerics.arrays import Array
from ....core.shot.shot import KeyPoses
from .. import fcurves, lossless
from ..body import body_channels
from . import key_ownership

FrameNumbers = NDArray[np.int64]
KEY_FRAMES, KEY_TRANSLATIONS, KEY_ROTATIONS = (
    "kfmocap_key_frames",
    "kfmocap_key_translations",
    "kfmocap_key_rotations",
)
"""Custom properties of an armature: key poses that were written, as they were before Blender rounded them."""


def write_key_poses(armature: bpy.types.Object, key_poses: KeyPoses, frame_start: int) -> None:
    """Key the degrees of freedom that key poses fix, as an animator would: type KEYFRAME, Bezier.

    Parameters
    ----------
    frame_start : int
        Scene frame of shot frame 0.
    """
    channels = body_channels.list_channels(armature)
    bag = fcurves.ensure_channelbag(armature, armature.name)
    frames = np.asarray(key_poses.frames) + frame_start
    values = body_channels.channel_values(armature, key_poses.poses)
    fixed = body_channels.fixed_channels(armature, key_poses.fixed)
    for c, channel in enumerate(channels):
        keyed = fixed[:, c]
        if not keyed.any():
            continue
        curve = fcurves.ensure_fcurve(bag, channel.path, channel.index, channel.bone)
        old = fcurves.get_keys(curve)
        kept = old[~key_ownership.lie_on_frames(old, frames[keyed])]
        new = fcurves.new_keys(frames[keyed], values[keyed, c], "KEYFRAME", "BEZIER")
        fcurves.set_keys(curve, [kept, new])
    _remember(armature, frames, key_poses.poses)


def read_key_poses(armature: bpy.types.Object, frame_start: int, length: int) -> KeyPoses:
    """Return the animator's keys as key poses: every shot frame with a key that the tracker did not write.

    A bone with any of its rotation keyed fixes its rotation; the root's location is fixed per axis. Proposals of the
    tracker fix nothing.

    Parameters
    ----------
    frame_start : int
        Scene frame of shot frame 0.
    length : int
        Frames of the shot; keys outside are left out.

    Raises
    ------
    ShotError
        If one of the keys lies between frames.
    """
    channels = body_channels.list_channels(armature)
    keys = key_ownership.key_places(armature, channels)
    key_ownership.refuse_subframes(armature, channels, keys)
    index = keys.frames - frame_start
    inside = (index >= 0) & (index < length)
    held = np.zeros((length, len(channels)), bool)
    held[index[inside & keys.own], keys.channels[inside & keys.own]] = True
    proposed = np.zeros(length, bool)
    proposed[index[inside & keys.proposed & (keys.channels == 0)]] = True
    frames = np.flatnonzero(held.any(axis=1) | proposed)
    values = body_channels.evaluate_channels(armature, channels, frame_start + frames, keys.by_channel)
    poses = _unrounded(armature, frame_start + frames, body_channels.motion_of_values(armature, values))
    return KeyPoses(frames, poses, body_channels.fixed_dofs(armature, held[frames]))


def key_current_pose(armature: bpy.types.Object, frame: int, bones: Collection[str] | None = None) -> None:
    """Key the pose that an armature shows now, as the animator's own: type KEYFRAME also over tracked keys.

    Parameters
    ----------
    frame : int
        Scene frame.
    bones : collection of str, optional
        These bones alone; by default the whole body.
    """
    bag = fcurves.ensure_channelbag(armature, armature.name)
    for channel in body_channels.list_channels(armature):
        if bones is None or channel.bone in bones:
            value = getattr(armature.pose.bones[channel.bone], channel.attribute)[channel.index]
            curve = fcurves.ensure_fcurve(bag, channel.path, channel.index, channel.bone)
            key = curve.keyframe_points.insert(frame, value)
            key.type, key.interpolation = "KEYFRAME", "BEZIER"
            curve.update()


def remove_key_pose(armature: bpy.types.Object, frame: int, bones: Collection[str] | None = None) -> int:
    """Remove the animator's keys on a scene frame, of these bones or the whole body; returns their number."""
    channels, count = body_channels.list_channels(armature), 0
    for c, curve, keys, own in key_ownership.channel_keys(armature, channels):
        gone = own & key_ownership.lie_on_frames(keys, np.array([frame]))
        if gone.any() and (bones is None or channels[c].bone in bones):
            count += int(gone.sum())
            fcurves.set_keys(curve, [keys[~gone]])
    return count


def keyed_bones(armature: bpy.types.Object) -> tuple[dict[int, set[str]], list[int]]:
    """Bones with a key of the animator's by scene frame, and the frames of proposals."""
    channels = body_channels.list_channels(armature)
    keys = key_ownership.key_places(armature, channels)
    keyed: dict[int, set[str]] = {}
    for frame, c in zip(keys.frames[keys.own].tolist(), keys.channels[keys.own].tolist(), strict=True):
        keyed.setdefault(frame, set()).add(channels[c].bone)
    proposed = keys.frames[keys.proposed & (keys.channels == 0)].tolist()
    return keyed, [frame for frame in proposed if frame not in keyed]


def _remember(armature: bpy.types.Object, frames: FrameNumbers, poses: Motion) -> None:
    """Keep poses of scene frames as they were before rounding, beside those of other frames."""
    T, Q = poses.translations, poses.rotations
    if KEY_FRAMES in armature:
        old, T0, Q0 = _remembered(armature)
        kept = ~np.isin(old, frames)
        if kept.any() and Q0.shape[1:] == Q.shape[1:]:
            frames, T, Q = (np.concatenate(pair) for pair in ((old[kept], frames), (T0[kept], T), (Q0[kept], Q)))
    lossless.keep(armature, KEY_FRAMES, frames)
    lossless.keep(armature, KEY_TRANSLATIONS, T)
    lossless.keep(armature, KEY_ROTATIONS, Q)


def _remembered(armature: bpy.types.Object) -> tuple[FrameNumbers, Array, Array]:
    """Return the scene frames (K,) of the poses that are kept, their translations and rotations."""
    frames, T, Q = (lossless.stored(armature[name]) for name in (KEY_FRAMES, KEY_TRANSLATIONS, KEY_ROTATIONS))
    return frames.astype(np.int64), T, Q


def _unrounded(armature: bpy.types.Object, frames: FrameNumbers, read: Motion) -> Motion:
    """Return the poses that `write_key_poses` was given, where the keys still have them; else those read."""
    if KEY_FRAMES not in armature:
        return read
    first, T0, Q0 = _remembered(armature)
    T, Q = read.translations.copy(), read.rotations.copy()
    for i, frame in enumerate(frames):
        for k in np.flatnonzero(first == frame):
            if lossless.same(T0[k], T[i]):
                T[i] = T0[k]
            parts = min(len(Q[i]), len(Q0[k]))
            kept = lossless.alike(Q0[k, :parts], Q[i, :parts]).all(axis=(1, 2))
            Q[i, :parts][kept] = Q0[k, :parts][kept]
    return Motion(T, Q)
