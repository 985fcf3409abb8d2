"""Which keys are the animator's, and which the tracker wrote.

Keys of the type GENERATED that have the value which the tracker wrote are the tracker's, and those of channels that it
did not record, such as of bones that were renamed, if it recorded others; every other key is the animator's. Keys of
the type BREAKDOWN are the tracker's, too, while they have that value: key poses that it proposes.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import bpy
import numpy as np
from numpy.typing import NDArray

from ....core.errors import ShotError
from ....core.numerics.arrays import Bools
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


@dataclass(frozen=True, eq=False)
class KeyPlaces:
    """The keys of all channels, one channel after the other: K keys.

    Attributes
    ----------
    channels : ndarray of int, shape (K,)
        Numbers of the channels.
    places : ndarray, shape (K,)
        Scene frames, also between whole ones.
    own, proposed : ndarray of bool, shape (K,)
        Which are the animator's, and which are the tracker's proposals.
    by_channel : mapping of int to ndarray of fcurves.PLACES
        The keys of each channel that has an F-curve.
    """

    channels: FrameNumbers
    places: NDArray[np.float32]
    own: Bools
    proposed: Bools
    by_channel: Mapping[int, fcurves.Keys]

    @property
    def frames(self) -> FrameNumbers:
        """The scene frames that the keys lie on, or nearest to."""
        return np.rint(self.places).astype(np.int64)


def key_places(armature: bpy.types.Object, channels: list[body_channels.Channel]) -> KeyPlaces:
    """Return where the keys of all channels lie, and whose they are."""
    rows = list(channel_keys(armature, channels, fcurves.PLACES))
    by_channel = {c: keys for c, _, keys, _ in rows}
    numbers = np.repeat(list(by_channel), [len(keys) for keys in by_channel.values()]).astype(np.int64)
    if not len(numbers):
        return KeyPlaces(numbers, np.empty(0, np.float32), np.empty(0, bool), np.empty(0, bool), by_channel)
    own = np.concatenate([theirs for *_, theirs in rows])
    types = np.concatenate([keys["type"] for keys in by_channel.values()])
    places = np.concatenate([keys["co"][:, 0] for keys in by_channel.values()])
    return KeyPlaces(numbers, places, own, ~own & (types == fcurves.enum_value("type", PROPOSAL)), by_channel)


def are_animators(
    keys: Sequence[fcurves.Keys], record: tracked_keys.TrackedKeys, channels: Sequence[body_channels.Channel]
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
    rows = [record.values.get(channel.key) for channel in channels]
    tracked = np.repeat([row is not None for row in rows], counts)
    written = record.at(rows, np.repeat(np.arange(len(rows)), counts), frames)
    differ = (np.abs(places[:, 0] - frames) > _SAME_FRAME) | (places[:, 1] != written)
    proposed = types == fcurves.enum_value("type", PROPOSAL)
    generated = types == fcurves.enum_value("type", "GENERATED")
    # Without any record the tracker has written nothing: animators may choose its type for their keys, too.
    own = np.where(tracked, ~(generated | proposed) | differ, ~generated | (not record.values))
    return np.split(own, np.cumsum(counts)[:-1])


def proposal_frames(keys: fcurves.Keys, own: NDArray[np.bool_]) -> FrameNumbers:
    """Return the scene frames of proposals, of a channel's keys and which of them are the animator's."""
    return fcurves.frames_of(keys)[~own & (keys["type"] == fcurves.enum_value("type", PROPOSAL))]


def lie_on_frames(keys: fcurves.Keys, frames: FrameNumbers) -> NDArray[np.bool_]:
    """Return which keys lie on one of the scene frames, shape (K,)."""
    on = fcurves.frames_of(keys)
    return fcurves.are_among(on, frames) & (np.abs(keys["co"][:, 0] - on) <= _SAME_FRAME)


def refuse_subframes(armature: bpy.types.Object, channels: list[body_channels.Channel], keys: KeyPlaces) -> None:
    """Raise a ShotError where a key of the animator's lies between frames."""
    between = np.flatnonzero(keys.own & (np.abs(keys.places - keys.frames) > _SAME_FRAME))
    if len(between):
        raise ShotError(
            f"a key at frame {keys.places[between[0]]:.2f} lies between frames",
            where=f"armature {armature.name}, bone {channels[keys.channels[between[0]]].bone}",
            todo="snap the keys to whole frames",
        )
