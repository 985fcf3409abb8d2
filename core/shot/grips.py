"""Grips: how props are held, as the key poses show."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from ..body.kinematics import Poses, part_poses
from ..errors import ShotError
from ..numerics.arrays import Array, Ints
from .holds import Grip, Hold, check_names
from .shot import KeyPoses, Performer, Shot


def completed(shot: Shot) -> Shot:
    """Return the shot with everything filled in that depends on the whole shot, so that segments can be tracked
    alone.
    """
    return shot_with_grips(shot.with_settings_filled())


def shot_with_grips(shot: Shot) -> Shot:
    """Return the shot with the grips of its holds, see `with_grips`."""
    return replace(shot, holds=with_grips(shot.holds, shot.performers, shot.frames[0]))


def with_grips(holds: Sequence[Hold], performers: Sequence[Performer], zero: int = 0) -> tuple[Hold, ...]:
    """Return holds with the grips that the key poses within their ranges show; a grip that is given stays.

    Parameters
    ----------
    holds : sequence of Hold
    performers : sequence of Performer
    zero : int
        Number of shot frame 0 in messages.

    Raises
    ------
    ShotError
        A hold names a performer or part that does not exist, no frame within its range has a key pose of both bodies,
        or a prop is held twice at once.
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


def relative_pose(held: Poses, holding: Poses, part: int) -> tuple[Array, Array]:
    """Return the rotation (F, 3, 3) and position (F, 3), metres, of a prop's root part relative to the part that holds
    it.
    """
    (R_prop, T_prop), (R, T) = held, holding
    back = np.swapaxes(R[:, part], -1, -2)
    return back @ R_prop[:, 0], (back @ (T_prop[:, 0] - T[:, part])[..., None])[..., 0]


def _checked(hold: Hold, by_name: Mapping[str, Performer]) -> tuple[Performer, Performer, int]:
    """Return the prop, its holder, and the index of the part that holds it."""
    check_names(hold, by_name)
    parts = by_name[hold.holder].body.names
    if hold.part not in parts:
        what = f"{hold.holder} has no part '{hold.part}'"
        raise ShotError(what, where=hold.place, todo=f"its parts are {', '.join(parts)}")
    return by_name[hold.prop], by_name[hold.holder], parts.index(hold.part)


def _posed(keys: KeyPoses) -> Ints:
    """Return the frames with a key pose of the whole body, set or proposed."""
    return np.concatenate([keys.full(), keys.proposals()])


def _poses_at(performer: Performer, frames: Ints) -> Poses:
    keys = performer.key_poses
    return part_poses(performer.body, keys.poses[np.searchsorted(keys.frames, frames)])


def _refuse_two_at_once(holds: Sequence[Hold], zero: int) -> None:
    """Raise a ShotError if two holds tie the same part and prop on one frame; two hands may hold a prop."""
    for i, one in enumerate(holds):
        for other in holds[:i]:
            same = (one.prop, one.holder, one.part) == (other.prop, other.holder, other.part)
            first, last = max(one.frames[0], other.frames[0]), min(one.frames[1], other.frames[1])
            if same and first <= last:
                what = f"{one.part} of {one.holder} holds {one.prop} twice on frames {zero + first} to {zero + last}"
                raise ShotError(what, where=one.place, todo="make one of it, or let the ranges follow each other")
