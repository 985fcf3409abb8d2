"""Tracked motion as keys of the type GENERATED, beside the animator's keys."""

from __future__ import annotations

from collections.abc import Collection, Sequence

import bpy
import numpy as np
from numpy.typing import ArrayLike, NDArray

from ....core.body.motion import Motion
from ....core.errors import BodyError
from ....core.numerics.arrays import Array
from .. import fcurves
from ..body import body_armature, body_channels
from . import key_ownership, tracked_keys


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
    channels = body_channels.list_channels(armature)
    if len(channels) != 3 + 4 * motion.rotations.shape[1]:
        raise BodyError(
            f"the motion has {motion.rotations.shape[1]} parts, the armature {len(body_armature.body_bones(armature))}",
            where=f"armature {armature.name}",
        )
    bag = fcurves.ensure_channelbag(armature, armature.name)
    record = tracked_keys.load(armature)
    curves = [fcurves.ensure_fcurve(bag, c.path, c.index, c.bone) for c in channels]
    keys = [fcurves.get_keys(curve) for curve in curves]
    own = key_ownership.are_animators(keys, record, channels)
    if proposed is None:
        proposed = key_ownership.proposal_frames(keys[0], own[0])
    frames = frame_start + np.arange(len(motion))
    held, kept = _held_and_kept(keys, own, frames)
    before = np.zeros(held.shape)  # it counts beside the animator's keys alone
    keyed = held.any(axis=1)
    before[keyed] = body_channels.evaluate_channels(armature, channels, frames[keyed], dict(enumerate(keys)))
    values, breaks = _beside_keys(body_channels.channel_values(armature, motion), before, held)
    new = _tracked_keys(values, breaks, frames, proposed)
    for c, curve in enumerate(curves):
        fcurves.set_keys(curve, [keys[c][kept[c]], new[c][~held[:, c]]], before=keys[c])
    recorded = np.where(held, np.nan, values).T.astype(np.float32)
    tracked_keys.store(
        armature, record.updated(frame_start, {c.key: row for c, row in zip(channels, recorded, strict=True)})
    )


def _held_and_kept(
    keys: Sequence[fcurves.Keys], own: Sequence[NDArray[np.bool_]], frames: NDArray[np.int64]
) -> tuple[NDArray[np.bool_], list[NDArray[np.bool_]]]:
    """Return on which frames (F,), one after the other, the animator has a key on each channel, shape (F, C), and which
    keys of each channel stay when these frames are written: the animator's, and those of other frames.
    """
    counts = [len(each) for each in keys]
    every, theirs = fcurves.joined(keys), np.concatenate(own)
    inside = key_ownership.lie_on_frames(every, frames)
    held = np.zeros((len(frames), len(keys)), bool)
    rows = fcurves.frames_of(every) - frames[0]
    among = theirs & (rows >= 0) & (rows < len(frames))
    held[rows[among], np.repeat(np.arange(len(keys)), counts)[among]] = True
    return held, np.split(theirs | ~inside, np.cumsum(counts)[:-1])


def _tracked_keys(
    values: Array, breaks: NDArray[np.bool_], frames: NDArray[np.int64], proposed: ArrayLike
) -> fcurves.Keys:
    """Return the tracker's keys of all channels, shape (C, F), for values (F, C); see `_beside_keys`."""
    blank = fcurves.new_keys(frames, np.zeros(len(frames)), "GENERATED", "LINEAR")
    blank["type"][fcurves.are_among(frames, proposed)] = fcurves.enum_value("type", key_ownership.PROPOSAL)
    new = np.tile(blank, (values.shape[1], 1))
    for point in ("co", "handle_left", "handle_right"):
        new[point][..., 1] = values.T
    new["interpolation"][breaks.T] = fcurves.enum_value("interpolation", "CONSTANT")
    return new


def read_motion(armature: bpy.types.Object, frame_start: int, length: int) -> Motion:
    """Return the motion that the F-curves show, whoever set their keys, on scene frames from `frame_start` on."""
    channels = body_channels.list_channels(armature)
    return body_channels.motion_of_values(
        armature, body_channels.evaluate_channels(armature, channels, frame_start + np.arange(length))
    )


def clear_motion(armature: bpy.types.Object, frames: ArrayLike) -> set[int]:
    """Remove the keys that the tracker wrote on scene frames; the animator's keys and the tracker's proposals stay.

    Returns
    -------
    set of int
        The frames on which there were any.
    """
    cleared: set[int] = set()
    for _, curve, keys, own in key_ownership.channel_keys(armature, body_channels.list_channels(armature)):
        gone = (
            ~own
            & key_ownership.lie_on_frames(keys, np.asarray(frames))
            & (keys["type"] == fcurves.enum_value("type", "GENERATED"))
        )
        if gone.all():
            fcurves.find_channelbag(armature).fcurves.remove(curve)
        elif gone.any():
            fcurves.set_keys(curve, [keys[~gone]])
        cleared.update(fcurves.frames_of(keys)[gone].tolist())
    return cleared


def keyed_frames(armature: bpy.types.Object, frame_start: int, length: int) -> NDArray[np.bool_]:
    """Return the scene frames from `frame_start` on that have a key on every channel, whoever set it, shape
    (length,).
    """
    bag = fcurves.find_channelbag(armature)
    frames = frame_start + np.arange(length)
    keyed = np.full(length, bag is not None)
    for channel in body_channels.list_channels(armature) if bag else ():
        curve = bag.fcurves.find(channel.path, index=channel.index)
        keyed &= fcurves.are_among(frames, fcurves.frames_of(fcurves.get_keys(curve, fcurves.PLACES)) if curve else [])
    return keyed


def tracked_runs(armature: bpy.types.Object) -> list[tuple[int, int]]:
    """First and last scene frames of the runs on which the tracker, and not the animator, keyed the body's place."""
    place = body_channels.list_channels(armature)[:1]
    for _, _, keys, own in key_ownership.channel_keys(armature, place, fcurves.PLACES):
        tracked = ~own & (keys["type"] == fcurves.enum_value("type", "GENERATED"))
        frames = np.unique(fcurves.frames_of(keys)[tracked])
        runs = np.split(frames, np.flatnonzero(np.diff(frames) > 1) + 1)
        return [(int(run[0]), int(run[-1])) for run in runs if len(run)]
    return []


def bake(armature: bpy.types.Object, bones: Collection[str] | None = None) -> int:
    """Make the tracker's keys ordinary ones, of these bones or the whole body; on how many frames there were any.

    They are the animator's from then on: no tracking replaces them.
    """
    channels, baked = body_channels.list_channels(armature), set()
    for c, curve, keys, own in key_ownership.channel_keys(armature, channels):
        if not own.all() and (bones is None or channels[c].bone in bones):
            baked.update(fcurves.frames_of(keys)[~own].tolist())
            keys["type"][~own] = fcurves.enum_value("type", "KEYFRAME")
            fcurves.set_keys(curve, [keys])
    return len(baked)


def accept_proposals(armature: bpy.types.Object, frames: Collection[int]) -> None:
    """Make proposed key poses of scene frames the animator's own."""
    _turn_proposals(armature, frames, "KEYFRAME", "BEZIER")


def refuse_proposals(armature: bpy.types.Object, frames: Collection[int]) -> None:
    """Make proposed key poses of scene frames tracked ones like those between them."""
    _turn_proposals(armature, frames, "GENERATED", "LINEAR")


def _turn_proposals(armature: bpy.types.Object, frames: Collection[int], kind: str, interpolation: str) -> None:
    for _, curve, keys, own in key_ownership.channel_keys(armature, body_channels.list_channels(armature)):
        proposed = (
            ~own
            & fcurves.are_among(fcurves.frames_of(keys), list(frames))
            & (keys["type"] == fcurves.enum_value("type", key_ownership.PROPOSAL))
        )
        if proposed.any():
            keys["type"][proposed] = fcurves.enum_value("type", kind)
            keys["interpolation"][proposed] = fcurves.enum_value("interpolation", interpolation)
            fcurves.set_keys(curve, [keys])


def _beside_keys(values: Array, before: Array, held: NDArray[np.bool_]) -> tuple[Array, NDArray[np.bool_]]:
    """Fit tracked quaternions to the animator's: q and -q are one rotation, but not to a curve.

    Parameters
    ----------
    values, before : ndarray, shape (F, C)
        Tracked values, signs continuous; values of the curves as they were, on the frames where something is held.
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
