"""Holds: over a range of frames, a prop stays fixed to the hand of a performer, or to any other part.

A prop is a performer like others, with a body and key poses of its own. While it is held, its pose relative to the part
that holds it (the grip) is that of the key poses within the range (`core.shot.grips`).
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from ..errors import ShotError
from ..numerics.arrays import Array, Ints


@dataclass(frozen=True, eq=False)
class Grip:
    """The pose of a prop relative to the part that holds it, on K frames.

    Attributes
    ----------
    frames : ndarray of int, shape (K,)
        Shot frames, increasing.
    turns : ndarray, shape (K, 3, 3)
        Rotation of the prop's root part relative to the part that holds it.
    places : ndarray, shape (K, 3)
        Position of the prop's root joint in the axes of that part, metres.
    """

    frames: Ints
    turns: Array
    places: Array

    def at(self, frames: Ints) -> tuple[Array, Array]:
        """Return the rotation (F, 3, 3) and the position (F, 3) on frames, interpolated between the key poses."""
        inside = np.clip(frames, self.frames[0], self.frames[-1])
        places = np.stack([np.interp(inside, self.frames, column) for column in self.places.T], axis=1)
        if len(self.frames) == 1:
            return np.repeat(self.turns, len(frames), axis=0), places
        return Slerp(self.frames, Rotation.from_matrix(self.turns))(inside).as_matrix(), places


@dataclass(frozen=True, eq=False)
class Hold:
    """A prop that is held over a range of frames.

    Attributes
    ----------
    prop : str
        Name of the performer that is held; its root part is tied to the holder.
    holder : str
        Name of the performer that holds it.
    part : str
        The part of the holder's body that holds it.
    frames : tuple of int
        First and last shot frame, inclusive.
    grip : Grip, optional
        See `core.shot.grips`.
    where : str
        File and table, for error messages.
    """

    prop: str
    holder: str
    part: str
    frames: tuple[int, int]
    grip: Grip | None = field(default=None, compare=False)
    where: str = field(default="", compare=False)

    def later(self, frames: int) -> Hold:
        """Return the hold with frame numbers increased by `frames`."""
        first, last = self.frames
        grip = None if self.grip is None else replace(self.grip, frames=self.grip.frames + frames)
        return replace(self, frames=(first + frames, last + frames), grip=grip)

    @property
    def place(self) -> str:
        """Name of the hold in messages."""
        return self.where or f"{self.prop} in {self.part} of {self.holder}"

    def field(self, key: str) -> str:
        """Return the name of one of its fields in messages; only in a file do fields have names."""
        return f"{self.where} {key}" if self.where else self.place


def holds_between(holds: Sequence[Hold], first: int, last: int) -> tuple[Hold, ...]:
    """Return the holds on shot frames first to last, counted from the first of these."""
    inside = [h for h in holds if h.frames[0] <= last and h.frames[1] >= first]
    return tuple(replace(h, frames=(max(h.frames[0], first), min(h.frames[1], last))).later(-first) for h in inside)


def check_names(hold: Hold, performers: Collection[str]) -> None:
    """Check that the names of a hold's prop and holder are two of the performers'.

    Raises
    ------
    ShotError
        One is not, or both are the same.
    """
    for key, name in (("prop", hold.prop), ("holder", hold.holder)):
        if name not in performers:
            what = f"there is no performer '{name}'"
            raise ShotError(what, where=hold.field(key), todo=f"there are {', '.join(performers)}")
    if hold.prop == hold.holder:
        raise ShotError(f"'{hold.prop}' cannot hold itself", where=hold.field("prop"))
