"""What the tracker wrote: kept in the action, so that an animator's edit of a tracked key is recognised.

Blender keeps the type GENERATED when a key is inserted over one or when one is dragged: only its value shows it.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import bpy
import numpy as np
from numpy.typing import NDArray

PROPERTY = "kfmocap_written"
"""Custom property of an action: a record for each of its slots."""


@dataclass(frozen=True, eq=False)
class TrackedKeys:
    """Values that the tracker wrote into the F-curves of one slot.

    Attributes
    ----------
    first : int
        Scene frame of the first value.
    values : mapping of str to ndarray of float32, shape (F,)
        By channel ("data path[index]"); NaN where nothing was written.
    """

    first: int
    values: Mapping[str, NDArray[np.float32]]

    def at(
        self, rows: Sequence[NDArray[np.float32] | None], channels: NDArray[np.int64], frames: NDArray[np.int64]
    ) -> NDArray[np.float32]:
        """Return the values written for keys (K,), NaN where none was.

        Parameters
        ----------
        rows : sequence of ndarray or None
            The values of some channels; None for a channel never written.
        channels, frames : ndarray of int, shape (K,)
            Places among `rows`, and scene frames.
        """
        length = max((len(row) for row in rows if row is not None), default=0)
        # One more value, which is NaN, for frames outside.
        table = np.full((len(rows), length + 1), np.nan, np.float32)
        for values, row in zip(table, rows, strict=True):
            if row is not None:
                values[: len(row)] = row
        index = frames - self.first
        return table[channels, np.where((index >= 0) & (index < length), index, length)]

    def updated(self, first: int, values: Mapping[str, NDArray[np.float32]]) -> TrackedKeys:
        """Return a record with the values of a later tracking, shape (F,) per channel, put over this one's."""
        lengths = [len(v) for v in self.values.values()]
        start = min(first, self.first) if lengths else first
        stop = max([first + len(v) for v in values.values()] + [self.first + n for n in lengths])
        merged = {}
        for channel in {**self.values, **values}:
            row = np.full(stop - start, np.nan, np.float32)
            for begin, source in ((self.first, self.values.get(channel)), (first, values.get(channel))):
                if source is not None:
                    row[begin - start : begin - start + len(source)] = source
            merged[channel] = row
        return TrackedKeys(start, merged)


def is_recorded(owner: bpy.types.Object | None) -> bool:
    """Whether there is a record for some slot of the object's action."""
    data = owner.animation_data if owner is not None else None
    return data is not None and data.action is not None and PROPERTY in data.action


def load(owner: bpy.types.Object) -> TrackedKeys:
    """Return the record for the object's action and slot; empty where the tracker wrote nothing yet."""
    action, slot = owner.animation_data.action, owner.animation_data.action_slot
    record = action.get(PROPERTY, {}).get(str(slot.handle))
    if record is None:
        return TrackedKeys(0, {})
    channels = json.loads(record["channels"])
    values = np.array(record["values"], np.float32).reshape(len(channels), -1)
    return TrackedKeys(record["first"], dict(zip(channels, values, strict=True)))


def store(owner: bpy.types.Object, record: TrackedKeys) -> None:
    """Keep the record in the object's action."""
    action, slot = owner.animation_data.action, owner.animation_data.action_slot
    if PROPERTY not in action:
        action[PROPERTY] = {}
    action[PROPERTY][str(slot.handle)] = {
        "first": record.first,
        "channels": json.dumps(list(record.values)),
        "values": np.concatenate(list(record.values.values())),
    }
