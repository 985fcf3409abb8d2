"""Holds: over a range of frames a prop stays in the hand of a performer, or on any other part.

A prop is a performer like others, with a body and key poses of its own. While it is held its pose relative to the part
that holds it, its grip, is that of the key poses within the range.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from ..body.kinematics import Poses, part_poses
from ..errors import ShotError
from ..numerics.arrays import Array, Ints

if TYPE_CHECKING:
    from .shot import KeyPoses, Performer


@dataclass(frozen=True, eq=False)
class Grip:
    """How a prop lies in what holds it, on K frames.

    Attributes
    ----------
    frames : ndarray of int, shape (K,)
        Shot frames, increasing.
    turns : ndarray, shape (K, 3, 3)
        Rotation of the prop's topmost part relative to the part that holds it.
    places : ndarray, shape (K, 3)
        Its joint in the axes of that part, metres.
    """

    frames: Ints
    turns: Array
    places: Array

    def at(self, frames: Ints) -> tuple[Array, Array]:
        """The rotation (F, 3, 3) and the place (F, 3) on frames: where key poses differ, between theirs."""
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
        Name of the performer that is held, by the topmost part of its body.
    holder : str
        Name of the performer that holds it.
    part : str
        The part of the holder's body that does.
    frames : tuple of int
        First and last shot frame, inclusive.
    grip : Grip, optional
        See `with_grips`.
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
        """The hold in a count whose frame 0 is that many frames earlier."""
        first, last = self.frames
        grip = None if self.grip is None else replace(self.grip, frames=self.grip.frames + frames)
        return replace(self, frames=(first + frames, last + frames), grip=grip)

    @property
    def place(self) -> str:
        """What messages call it."""
        return self.where or f"{self.prop} in {self.part} of {self.holder}"

    def field(self, key: str) -> str:
        """What messages call one of its fields: in a file it has a name."""
        return f"{self.where} {key}" if self.where else self.place


def holds_between(holds: Sequence[Hold], first: int, last: int) -> tuple[Hold, ...]:
    """Return the holds on shot frames first to last, counted from the first of these."""
    inside = [h for h in holds if h.frames[0] <= last and h.frames[1] >= first]
    return tuple(replace(h, frames=(max(h.frames[0], first), min(h.frames[1], last))).later(-first) for h in inside)


def with_grips(holds: Sequence[Hold], performers: Sequence[Performer], zero: int = 0) -> tuple[Hold, ...]:
    """Return the holds with the grips that the key poses within their ranges show; those that have one keep it.

    Parameters
    ----------
    holds : sequence of Hold
    performers : sequence of Performer
    zero : int
        What messages count shot frame 0 as.

    Raises
    ------
    ShotError
        A hold names what is not there, or no frame within its range has a key pose of both bodies, or a prop is held
        twice at once; says which.
    """
    by_name = {performer.name: performer for performer in performers}
    found = []
    for hold in holds:
        prop, holder, part = _checked(hold, by_name)
        if hold.grip is not None:
            found.append(hold)
            continue
        first, last = hold.frames
        frames = np.intersect1d(_posed(prop.key_poses), _posed(holder.key_poses))
        frames = frames[(frames >= first) & (frames <= last)]
        if not len(frames):
            what = f"no frame from {zero + first} to {zero + last} has a key pose of both {prop.name} and {holder.name}"
            todo = "set key poses of both on one of these frames: they show how it is held"
            raise ShotError(what, where=hold.place, todo=todo)
        held, holding = (_poses_at(performer, frames) for performer in (prop, holder))
        found.append(replace(hold, grip=Grip(frames, *relative_pose(held, holding, part))))
    _refuse_two_at_once(found, zero)
    return tuple(found)


def check_names(hold: Hold, performers: Collection[str]) -> None:
    """See that a hold is between two of some performers.

    Raises
    ------
    ShotError
        Names the field, where the hold comes from a file.
    """
    for key, name in (("prop", hold.prop), ("holder", hold.holder)):
        if name not in performers:
            what = f"there is no performer '{name}'"
            raise ShotError(what, where=hold.field(key), todo=f"there are {', '.join(performers)}")
    if hold.prop == hold.holder:
        raise ShotError(f"'{hold.prop}' cannot hold itself", where=hold.field("prop"))


def relative_pose(held: Poses, holding: Poses, part: int) -> tuple[Array, Array]:
    """Rotation (F, 3, 3) and place (F, 3) of a prop's topmost part relative to a part of what holds it."""
    (R_prop, T_prop), (R, T) = held, holding
    back = np.swapaxes(R[:, part], -1, -2)
    return back @ R_prop[:, 0], (back @ (T_prop[:, 0] - T[:, part])[..., None])[..., 0]


def _checked(hold: Hold, by_name: Mapping[str, Performer]) -> tuple[Performer, Performer, int]:
    """The prop, its holder, and the number of the part that holds it."""
    check_names(hold, by_name)
    parts = by_name[hold.holder].body.names
    if hold.part not in parts:
        what = f"{hold.holder} has no part '{hold.part}'"
        raise ShotError(what, where=hold.place, todo=f"its parts are {', '.join(parts)}")
    return by_name[hold.prop], by_name[hold.holder], parts.index(hold.part)


def _posed(keys: KeyPoses) -> Ints:
    """Frames with a key pose of the whole body, or a proposed one."""
    return np.concatenate([keys.full(), keys.proposals()])


def _poses_at(performer: Performer, frames: Ints) -> Poses:
    keys = performer.key_poses
    return part_poses(performer.body, keys.poses[np.searchsorted(keys.frames, frames)])


def _refuse_two_at_once(holds: Sequence[Hold], zero: int) -> None:
    """Raise a ShotError where the same two are tied to each other twice on a frame: two hands may hold a prop."""
    for i, one in enumerate(holds):
        for other in holds[:i]:
            same = (one.prop, one.holder, one.part) == (other.prop, other.holder, other.part)
            first, last = max(one.frames[0], other.frames[0]), min(one.frames[1], other.frames[1])
            if same and first <= last:
                what = f"{one.part} of {one.holder} holds {one.prop} twice on frames {zero + first} to {zero + last}"
                raise ShotError(what, where=one.place, todo="make one of it, or let the ranges follow each other")
