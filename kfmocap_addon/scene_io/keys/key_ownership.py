"""Which keys are the animator's, and which the tracker wrote.

Keys of the type GENERATED that have the value which the tracker wrote are the tracker's; every other key is the
animator's. Keys of the type BREAKDOWN are the tracker's, too, while they have that value: key poses that it proposes.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import bpy
import numpy as np
from numpy.typing import NDArray

from ....core.errors import ShotError
from .. import fcurves
from ..body import body_channels
from . import tracked_keys

FrameNumbers = NDArray[np.int64]
PROPOSAL = "BREAKDOWN"
"""Type of the keys of a proposed key pose."""
_SAME_FRAME = 0.01  # Blender's own threshold for keys on the same frame


def channel_keys(
    armature: bpy.types.Object, channels: list[body_channels.Channel], fields: np.dtype[np.void] = fcurves.KEY_TYPE
) -> Iterator[tuple[int, bpy.types.FCurve, fcurves.Keys, NDArray[np.bool_]]]:
    """Go through the channels that have an F-curve: number, curve, keys, and which of the keys are the animator's.

    `fields` are the properties of keys that are read: `fcurves.PLACES` is enough for whoever does not write them again.
    """
    bag = fcurves.find_channelbag(armature)
    if bag is None:
        return
    record = tracked_keys.load(armature)
    curves = [bag.fcurves.find(channel.path, index=channel.index) for channel in channels]
    found = [(c, curve, fcurves.get_keys(curve, fields)) for c, curve in enumerate(curves) if curve is not None]
    own = are_animators([keys for _, _, keys in found], record, [channels[c] for c, _, _ in found])
    for (c, curve, keys), theirs in zip(found, own, strict=True):
        yield c, curve, keys, theirs


def are_animators(
    keys: Sequence[fcurves.Keys], record: tracked_keys.Written, channels: Sequence[body_channels.Channel]
) -> list[NDArray[np.bool_]]:
    """Return which keys of channels are the animator's, shape (K,) each: not of the tracker's types, or not where it
    wrote one.
    """
    if not channels:
        return []
    # All channels at once: there are some eighty, with few keys each.
    places = np.concatenate([each["co"] for each in keys])
    types = np.concatenate([each["type"] for each in keys])
    frames = np.rint(places[:, 0]).astype(np.int64)
    counts = [len(each) for each in keys]
    ends = np.cumsum(counts)
    values = [record.at(c.key, frames[end - n : end]) for c, n, end in zip(channels, counts, ends, strict=True)]
    tracked = np.repeat([value is not None for value in values], counts)
    written = np.concatenate([np.zeros(n) if v is None else v for v, n in zip(values, counts, strict=True)])
    differ = (np.abs(places[:, 0] - frames) > _SAME_FRAME) | (places[:, 1] != written)
    proposed = types == fcurves.enum_value("type", PROPOSAL)
    generated = types == fcurves.enum_value("type", "GENERATED")
    own = np.where(tracked, ~(generated | proposed) | differ, ~generated)
    return np.split(own, ends[:-1])


def proposal_frames(keys: fcurves.Keys, own: NDArray[np.bool_]) -> FrameNumbers:
    """Return the scene frames of proposals, of a channel's keys and which of them are the animator's."""
    return fcurves.frames_of(keys)[~own & (keys["type"] == fcurves.enum_value("type", PROPOSAL))]


def lie_on_frames(keys: fcurves.Keys, frames: FrameNumbers) -> NDArray[np.bool_]:
    """Return which keys lie on one of the scene frames, shape (K,)."""
    on = fcurves.frames_of(keys)
    return fcurves.are_among(on, frames) & (np.abs(keys["co"][:, 0] - on) <= _SAME_FRAME)


def refuse_subframes(armature: bpy.types.Object, channel: body_channels.Channel, keys: fcurves.Keys) -> None:
    """Raise a ShotError where a key lies between frames."""
    if not len(keys):
        return
    between = np.abs(keys["co"][:, 0] - fcurves.frames_of(keys)) > _SAME_FRAME
    if between.any():
        frame = float(keys["co"][between, 0][0])
        raise ShotError(
            f"a key at frame {frame:.2f} lies between frames",
            where=f"armature {armature.name}, bone {channel.bone}",
            todo="snap the keys to whole frames",
        )
