"""Motion as F-curves, and the animator's keys as key poses.

The body's channels are the rotation of every bone and the location of the root. Keys of the type GENERATED,
with the value that the tracker wrote, are the tracker's; every other key on them is the animator's. Those of the type
BREAKDOWN are the tracker's, too, while they have that value: key poses that it proposes.
"""

from __future__ import annotations

import json
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass

import bpy
import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import Rotation

from ...core.body.motion import Motion
from ...core.errors import BodyError, ShotError
from ...core.shot.shot import KeyPoses
from . import body_armature, fcurves, lossless, tracked_keys

Array = NDArray[np.float64]
FrameNumbers = NDArray[np.int64]

KEY_FRAMES, KEY_TRANSLATIONS, KEY_ROTATIONS = (
    "kfmocap_key_frames",
    "kfmocap_key_translations",
    "kfmocap_key_rotations",
)
PROPOSAL = "BREAKDOWN"
"""Type of the keys of a proposed key pose."""
_SAME_FRAME = 0.01  # Blender's own threshold for keys on the same frame


@dataclass(frozen=True)
class Channel:
    """One animated component: the root's location or a bone's quaternion."""

    bone: str
    property: str
    index: int

    @property
    def path(self) -> str:
        return f'pose.bones["{bpy.utils.escape_identifier(self.bone)}"].{self.property}'

    @property
    def key(self) -> str:
        """Its name in the record of what was written."""
        return f"{self.path}[{self.index}]"


def body_channels(armature: bpy.types.Object) -> list[Channel]:
    """The root's location (3), then the quaternion (w, x, y, z) of every part in the body's order."""
    bones = body_armature.body_bones(armature)
    for bone in bones:
        mode = armature.pose.bones[bone.name].rotation_mode
        if mode != "QUATERNION":
            raise BodyError(
                f"the bone's rotation mode is {mode}",
                where=f"armature {armature.name}, bone {bone.name}",
                todo="set it to Quaternion (WXYZ)",
            )
    root = [Channel(bones[0].name, "location", k) for k in range(3)]
    return root + [Channel(bone.name, "rotation_quaternion", k) for bone in bones for k in range(4)]


def write_key_poses(armature: bpy.types.Object, key_poses: KeyPoses, frame_start: int) -> None:
    """Key the degrees of freedom that key poses fix, as an animator would: type KEYFRAME, Bezier.

    Parameters
    ----------
    frame_start : int
        Scene frame of shot frame 0.
    """
    channels = body_channels(armature)
    bag = fcurves.ensure_channelbag(armature, armature.name)
    frames = np.asarray(key_poses.frames) + frame_start
    values = _values(armature, key_poses.poses)
    fixed = _fixed_channels(armature, key_poses.fixed)
    for c, channel in enumerate(channels):
        keyed = fixed[:, c]
        if not keyed.any():
            continue
        curve = fcurves.ensure_fcurve(bag, channel.path, channel.index, channel.bone)
        old = fcurves.get_keys(curve)
        kept = old[~_on_frames(old, frames[keyed])]
        new = fcurves.new_keys(frames[keyed], values[keyed, c], "KEYFRAME", "BEZIER")
        fcurves.set_keys(curve, [kept, new])
    _remember(armature, frames, key_poses.poses)


def write_motion(
    armature: bpy.types.Object, motion: Motion, frame_start: int, proposed: ArrayLike | None = None
) -> None:
    """Write tracked frames as keys of type GENERATED, in place of those of an earlier tracking.

    The animator's keys stay as they are, and nothing is written on them. Earlier tracked keys outside the
    motion's frames stay too.

    Parameters
    ----------
    frame_start : int
        Scene frame of the motion's first pose.
    proposed : array-like of int, optional
        Scene frames whose poses are proposals; by default those on which there are proposals already.
    """
    channels = body_channels(armature)
    if len(channels) != 3 + 4 * motion.rotations.shape[1]:
        raise BodyError(
            f"the motion has {motion.rotations.shape[1]} parts, the armature {len(body_armature.body_bones(armature))}",
            where=f"armature {armature.name}",
        )
    bag = fcurves.ensure_channelbag(armature, armature.name)
    record = tracked_keys.load(armature)
    frames = frame_start + np.arange(len(motion))
    before = _evaluate(armature, channels, frames)
    curves = [fcurves.ensure_fcurve(bag, c.path, c.index, c.bone) for c in channels]
    keys = [fcurves.get_keys(curve) for curve in curves]
    own = [_animators(k, record, c) for k, c in zip(keys, channels, strict=True)]
    if proposed is None:
        proposed = _proposals(keys[0], own[0])
    held = np.stack([np.isin(frames, fcurves.frames_of(k[o])) for k, o in zip(keys, own, strict=True)], axis=1)
    values, breaks = _beside_keys(_values(armature, motion), before, held)

    recorded = {}
    for c, channel in enumerate(channels):
        free = ~held[:, c]
        new = fcurves.new_keys(frames[free], values[free, c], "GENERATED", "LINEAR")
        new["type"][np.isin(frames[free], proposed)] = fcurves.enum_value("type", PROPOSAL)
        new["interpolation"][breaks[free, c]] = fcurves.enum_value("interpolation", "CONSTANT")
        kept = keys[c][own[c] | ~_on_frames(keys[c], frames)]
        fcurves.set_keys(curves[c], [kept, new])
        recorded[channel.key] = np.where(free, values[:, c], np.nan).astype(np.float32)
    tracked_keys.store(armature, record.updated(frame_start, recorded))


def clear_motion(armature: bpy.types.Object, frames: ArrayLike) -> set[int]:
    """Remove the keys that the tracker wrote on scene frames; the animator's keys and the tracker's proposals stay.

    Returns
    -------
    set of int
        The frames on which there were any.
    """
    cleared: set[int] = set()
    for _, curve, keys, own in channel_keys(armature, body_channels(armature)):
        gone = ~own & _on_frames(keys, np.asarray(frames)) & (keys["type"] == fcurves.enum_value("type", "GENERATED"))
        if gone.all():
            fcurves.find_channelbag(armature).fcurves.remove(curve)
        elif gone.any():
            fcurves.set_keys(curve, [keys[~gone]])
        cleared.update(fcurves.frames_of(keys)[gone].tolist())
    return cleared


def keyed_frames(armature: bpy.types.Object, frame_start: int, length: int) -> NDArray[np.bool_]:
    """Scene frames from `frame_start` on that have a key on every channel, whoever set it, shape (length,)."""
    bag = fcurves.find_channelbag(armature)
    frames = frame_start + np.arange(length)
    keyed = np.full(length, bag is not None)
    for channel in body_channels(armature) if bag else ():
        curve = bag.fcurves.find(channel.path, index=channel.index)
        keyed &= np.isin(frames, fcurves.frames_of(fcurves.get_keys(curve)) if curve else [])
    return keyed


def read_key_poses(armature: bpy.types.Object, frame_start: int, length: int) -> KeyPoses:
    """The animator's keys as key poses: every shot frame with a key that the tracker did not write.

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
    channels = body_channels(armature)
    held = np.zeros((length, len(channels)), bool)
    proposed = np.zeros(length, bool)
    for c, _, keys, own in channel_keys(armature, channels):
        if c == 0:
            index = _proposals(keys, own) - frame_start
            proposed[index[(index >= 0) & (index < length)]] = True
        keys = keys[own]
        _refuse_subframes(armature, channels[c], keys)
        index = fcurves.frames_of(keys) - frame_start
        held[index[(index >= 0) & (index < length)], c] = True
    frames = np.flatnonzero(held.any(axis=1) | proposed)
    values = _evaluate(armature, channels, frame_start + frames)
    poses = _unrounded(armature, frame_start + frames, _motion(armature, values))
    return KeyPoses(frames, poses, _fixed_dofs(armature, held[frames]))


def keyed_bones(armature: bpy.types.Object) -> tuple[dict[int, set[str]], list[int]]:
    """Bones with a key of the animator's by scene frame, and the frames of proposals."""
    channels = body_channels(armature)
    keyed: dict[int, set[str]] = {}
    proposed: list[int] = []
    for c, _, keys, own in channel_keys(armature, channels):
        if c == 0:
            proposed = _proposals(keys, own).tolist()
        for frame in fcurves.frames_of(keys[own]).tolist():
            keyed.setdefault(frame, set()).add(channels[c].bone)
    return keyed, [frame for frame in proposed if frame not in keyed]


def accept_proposals(armature: bpy.types.Object, frames: Collection[int]) -> None:
    """Make proposed key poses of scene frames the animator's own."""
    for _, curve, keys, own in channel_keys(armature, body_channels(armature)):
        proposed = (
            ~own
            & np.isin(fcurves.frames_of(keys), list(frames))
            & (keys["type"] == fcurves.enum_value("type", PROPOSAL))
        )
        if proposed.any():
            keys["type"][proposed] = fcurves.enum_value("type", "KEYFRAME")
            keys["interpolation"][proposed] = fcurves.enum_value("interpolation", "BEZIER")
            fcurves.set_keys(curve, [keys])


def bake(armature: bpy.types.Object, bones: Collection[str] | None = None) -> int:
    """Make the tracker's keys ordinary ones, of these bones or the whole body; on how many frames there were any.

    They are the animator's from then on: no tracking replaces them.
    """
    channels, baked = body_channels(armature), set()
    for c, curve, keys, own in channel_keys(armature, channels):
        if not own.all() and (bones is None or channels[c].bone in bones):
            baked.update(fcurves.frames_of(keys)[~own].tolist())
            keys["type"][~own] = fcurves.enum_value("type", "KEYFRAME")
            fcurves.set_keys(curve, [keys])
    return len(baked)


def remove_key_pose(armature: bpy.types.Object, frame: int, bones: Collection[str] | None = None) -> int:
    """Take the animator's keys on a scene frame away, of these bones or the whole body; how many there were."""
    channels, count = body_channels(armature), 0
    for c, curve, keys, own in channel_keys(armature, channels):
        gone = own & _on_frames(keys, np.array([frame]))
        if gone.any() and (bones is None or channels[c].bone in bones):
            count += int(gone.sum())
            fcurves.set_keys(curve, [keys[~gone]])
    return count


def read_motion(armature: bpy.types.Object, frame_start: int, length: int) -> Motion:
    """The motion that the F-curves show, whoever set their keys, on scene frames from `frame_start` on."""
    channels = body_channels(armature)
    return _motion(armature, _evaluate(armature, channels, frame_start + np.arange(length)))


def shown_pose(armature: bpy.types.Object) -> Motion:
    """The one pose that an armature shows now, keyed or not."""
    return pose_of(armature, shown_values(armature))


def pose_of(armature: bpy.types.Object, values: Sequence[float]) -> Motion:
    """The one pose of values of the body's channels."""
    return _motion(armature, np.array([values]))


def shown_values(armature: bpy.types.Object) -> list[float]:
    """Values of the body's channels as the armature shows them now."""
    bones = armature.pose.bones
    return [getattr(bones[c.bone], c.property)[c.index] for c in body_channels(armature)]


def show_values(armature: bpy.types.Object, values: Sequence[float]) -> None:
    """Show values of the body's channels, without a key."""
    for channel, value in zip(body_channels(armature), values, strict=True):
        getattr(armature.pose.bones[channel.bone], channel.property)[channel.index] = value


def show_pose(armature: bpy.types.Object, pose: Motion, bones: Collection[str] | None = None) -> None:
    """Show one pose, of these bones or the whole body, without a key.

    Quaternions keep the sign that they have, so that keys of them go with others.
    """
    [values], shown = _values(armature, pose), shown_values(armature)
    q, before = (np.array(x[3:]).reshape(-1, 4) for x in (values, shown))
    signs = np.where(np.sum(q * before, axis=1, keepdims=True) < 0, -1.0, 1.0)
    wanted = [*values[:3], *(signs * q).ravel()]
    moved = [bones is None or channel.bone in bones for channel in body_channels(armature)]
    show_values(armature, [a if m else b for a, b, m in zip(wanted, shown, moved, strict=True)])


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
    for channel in body_channels(armature):
        if bones is None or channel.bone in bones:
            value = getattr(armature.pose.bones[channel.bone], channel.property)[channel.index]
            curve = fcurves.ensure_fcurve(bag, channel.path, channel.index, channel.bone)
            key = curve.keyframe_points.insert(frame, value)
            key.type, key.interpolation = "KEYFRAME", "BEZIER"
            curve.update()


def _remember(armature: bpy.types.Object, frames: FrameNumbers, poses: Motion) -> None:
    """Keep poses of scene frames as they were before rounding, beside those of other frames."""
    T, Q = poses.translations, poses.rotations
    if KEY_FRAMES in armature:
        old, T0, Q0 = (np.array(json.loads(armature[n])) for n in (KEY_FRAMES, KEY_TRANSLATIONS, KEY_ROTATIONS))
        kept = ~np.isin(old, frames)
        if kept.any() and Q0.shape[1:] == Q.shape[1:]:
            frames, T, Q = (np.concatenate(pair) for pair in ((old[kept], frames), (T0[kept], T), (Q0[kept], Q)))
    lossless.keep(armature, KEY_FRAMES, frames)
    lossless.keep(armature, KEY_TRANSLATIONS, T)
    lossless.keep(armature, KEY_ROTATIONS, Q)


def _unrounded(armature: bpy.types.Object, frames: FrameNumbers, read: Motion) -> Motion:
    """The poses that `write_key_poses` was given, where the keys still have them; else those read."""
    if KEY_FRAMES not in armature:
        return read
    first, T0, Q0 = (np.array(json.loads(armature[name])) for name in (KEY_FRAMES, KEY_TRANSLATIONS, KEY_ROTATIONS))
    T, Q = read.translations.copy(), read.rotations.copy()
    for i, frame in enumerate(frames):
        for k in np.flatnonzero(first == frame):
            if lossless.same(T0[k], T[i]):
                T[i] = T0[k]
            for p in range(min(len(Q[i]), len(Q0[k]))):
                if lossless.same(Q0[k, p], Q[i, p]):
                    Q[i, p] = Q0[k, p]
    return Motion(T, Q)


def channel_keys(
    armature: bpy.types.Object, channels: list[Channel]
) -> Iterator[tuple[int, bpy.types.FCurve, fcurves.Keys, NDArray[np.bool_]]]:
    """Of every channel that has an F-curve: its number, the curve, its keys, and which are the animator's."""
    bag = fcurves.find_channelbag(armature)
    record = tracked_keys.load(armature) if bag else None
    for c, channel in enumerate(channels):
        curve = bag.fcurves.find(channel.path, index=channel.index) if bag else None
        if curve is not None and record is not None:
            keys = fcurves.get_keys(curve)
            yield c, curve, keys, _animators(keys, record, channel)


def _animators(keys: fcurves.Keys, record: tracked_keys.Written, channel: Channel) -> NDArray[np.bool_]:
    """Which keys are the animator's, shape (K,): not of the tracker's types, or not where it wrote one."""
    other = keys["type"] != fcurves.enum_value("type", "GENERATED")
    values = record.at(channel.key, fcurves.frames_of(keys))
    if values is None:
        return other
    other &= keys["type"] != fcurves.enum_value("type", PROPOSAL)
    between = np.abs(keys["co"][:, 0] - fcurves.frames_of(keys)) > _SAME_FRAME
    return other | between | (keys["co"][:, 1] != values)


def _proposals(keys: fcurves.Keys, own: NDArray[np.bool_]) -> FrameNumbers:
    """Scene frames of proposals, of a channel's keys and which of them are the animator's."""
    return fcurves.frames_of(keys)[~own & (keys["type"] == fcurves.enum_value("type", PROPOSAL))]


def _on_frames(keys: fcurves.Keys, frames: FrameNumbers) -> NDArray[np.bool_]:
    """Which keys lie on one of the scene frames, shape (K,)."""
    return np.isin(fcurves.frames_of(keys), frames) & (
        np.abs(keys["co"][:, 0] - fcurves.frames_of(keys)) <= _SAME_FRAME
    )


def _refuse_subframes(armature: bpy.types.Object, channel: Channel, keys: fcurves.Keys) -> None:
    between = np.abs(keys["co"][:, 0] - fcurves.frames_of(keys)) > _SAME_FRAME
    if between.any():
        frame = float(keys["co"][between, 0][0])
        raise ShotError(
            f"a key at frame {frame:.2f} lies between frames",
            where=f"armature {armature.name}, bone {channel.bone}",
            todo="snap the keys to whole frames",
        )


def _evaluate(armature: bpy.types.Object, channels: list[Channel], frames: FrameNumbers) -> Array:
    """Values of the channels at scene frames, shape (K, C); a channel without keys has its present value."""
    bag = fcurves.find_channelbag(armature)
    values = np.empty((len(frames), len(channels)))
    for c, channel in enumerate(channels):
        curve = bag.fcurves.find(channel.path, index=channel.index) if bag else None
        if curve is not None and len(curve.keyframe_points):
            values[:, c] = [curve.evaluate(float(frame)) for frame in frames]
        else:
            values[:, c] = getattr(armature.pose.bones[channel.bone], channel.property)[channel.index]
    return values


def _values(armature: bpy.types.Object, motion: Motion) -> Array:
    """Channel values of a motion, shape (F, 3 + 4 P)."""
    A, place = _root_frame(armature)
    turns = motion.quaternions().reshape(len(motion), 4 * motion.rotations.shape[1])
    return np.concatenate([(motion.translations - place) @ A, turns], axis=1)


def _motion(armature: bpy.types.Object, values: Array) -> Motion:
    """The motion of channel values (F, 3 + 4 P); inverse of `_values`."""
    A, place = _root_frame(armature)
    wxyz = values[:, 3:].reshape(-1, 4)
    Q = Rotation.from_quat(wxyz[:, [1, 2, 3, 0]]).as_matrix() if len(wxyz) else np.empty((0, 3, 3))
    return Motion(values[:, :3] @ A.T + place, Q.reshape(len(values), (values.shape[1] - 3) // 4, 3, 3))


def _root_frame(armature: bpy.types.Object) -> tuple[Array, Array]:
    """Axes (3, 3) and origin (3,) in the world of the root bone's location channels."""
    R_object, place = body_armature.object_pose(armature)
    root = body_armature.body_bones(armature)[0]
    return R_object @ body_armature.rest_rotation(root), R_object @ np.array(root.head_local) + place


def _beside_keys(values: Array, before: Array, held: NDArray[np.bool_]) -> tuple[Array, NDArray[np.bool_]]:
    """Fit tracked quaternions to the animator's: q and -q are one rotation, but not to a curve.

    Parameters
    ----------
    values, before : ndarray, shape (F, C)
        Tracked values, signs continuous; values of the curves as they were.
    held : ndarray of bool, shape (F, C)
        Where the animator has a key.

    Returns
    -------
    values : ndarray, shape (F, C)
        Signs as the animator's last key has them, and where a bone is keyed in part, the curves' own values.
    breaks : ndarray of bool, shape (F, C)
        Keys that must hold until the next frame, because the animator's signs change there.
    """
    F = len(values)
    q, old = values[:, 3:].reshape(F, -1, 4).copy(), before[:, 3:].reshape(F, -1, 4)
    keyed = held[:, 3:].reshape(F, -1, 4).any(axis=2)
    same = np.where(np.sum(q * old, axis=2) < 0, -1.0, 1.0)
    # Each frame's sign is that of the last keyed frame; those before the first take the first's.
    frames = np.arange(F)[:, None]
    last = np.maximum.accumulate(np.where(keyed, frames, -1), axis=0)
    last = np.where(last < 0, np.argmax(keyed, axis=0), last)
    signs = np.where(keyed.any(axis=0), np.take_along_axis(same, last, axis=0), 1.0)
    q *= signs[..., None]
    q[keyed] = old[keyed]
    breaks = np.zeros(values.shape, bool)
    breaks[:-1, 3:] = np.repeat(signs[1:] != signs[:-1], 4, axis=1)
    return np.concatenate([values[:, :3], q.reshape(F, -1)], axis=1), breaks


def _fixed_dofs(armature: bpy.types.Object, held: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Degrees of freedom (K, D) fixed by keyed channels (K, C)."""
    axes = _aligned_axes(armature)
    turns = held[:, 3:].reshape(len(held), (held.shape[1] - 3) // 4, 4).any(axis=2)
    moves = np.repeat(held[:, :3].any(axis=1)[:, None], 3, axis=1) if axes is None else held[:, axes]
    return np.concatenate([moves, np.repeat(turns, 3, axis=1)], axis=1)


def _fixed_channels(armature: bpy.types.Object, fixed: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Channels (K, C) to key for fixed degrees of freedom (K, D): a bone's quaternion is keyed as a whole."""
    axes = _aligned_axes(armature)
    turns = fixed[:, 3:].reshape(len(fixed), fixed.shape[1] // 3 - 1, 3).any(axis=2)
    moves = np.repeat(fixed[:, :3].any(axis=1)[:, None], 3, axis=1)
    if axes is not None:
        moves = fixed[:, np.argsort(axes)]
    return np.concatenate([moves, np.repeat(turns, 4, axis=1)], axis=1)


def _aligned_axes(armature: bpy.types.Object) -> NDArray[np.int64] | None:
    """Location channel of each world axis, or None where the root's rest is askew: then all go together."""
    A = np.abs(_root_frame(armature)[0])
    return np.argmax(A, axis=1) if np.allclose(A.max(axis=1), 1.0, atol=1e-5) else None
