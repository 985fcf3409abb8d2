"""The controls of a rig that motion is put on: where they stand at rest, and which control each of them follows."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..body.skeleton_motion import RestSkeleton
from ..numerics.arrays import Array, Bools
from .roles import BoneMap


@dataclass(frozen=True, eq=False)
class ControlRig:
    """Controls, B of them, parents before children.

    Attributes
    ----------
    rest : RestSkeleton
        The controls in the world, metres; a parent is the control that carries another one's place along.
    bones : BoneMap
        Their roles.
    turn_parents : tuple of int
        The control whose rotation another one's rest orientation follows; -1 where none turns it.
    R_world_rest : ndarray, shape (B, 3, 3)
        Orientation at rest.
    location_axes : ndarray, shape (B, 3, 3)
        The axes of each control's location at rest, as columns: its own ones, or the armature's.
    scale : float
        Metres of the world for one unit of the armature.
    resting_toes : frozenset of str
        Sides whose feet have toe bones that are no controls here, and stay as they are: "L", "R".
    """

    rest: RestSkeleton
    bones: BoneMap
    turn_parents: tuple[int, ...]
    R_world_rest: Array
    location_axes: Array
    scale: float = 1.0
    resting_toes: frozenset[str] = frozenset()

    def index(self, role: str, place: int = 0) -> int:
        """Return the place of the control that plays a role."""
        return self.rest.indices([self.bones.bones[role][place]])[0]


@dataclass(frozen=True, eq=False)
class RigPoses:
    """What the controls shall do on every frame.

    Attributes
    ----------
    turns : ndarray, shape (F, B, 3, 3)
        Rotation from the rest orientation, in the world's axes.
    places : ndarray, shape (F, B, 3)
        Where the controls' heads are in the world, metres.
    driven : ndarray of bool, shape (B,)
        Which controls are moved; the others only follow.
    """

    turns: Array
    places: Array
    driven: Bools

    def __len__(self) -> int:
        return len(self.turns)


def carried(rig: ControlRig, turns: Array, driven: Bools, tops: dict[int, Array]) -> RigPoses:
    """Return the poses of all controls: each is where the control that carries it takes it.

    Parameters
    ----------
    turns : ndarray, shape (F, B, 3, 3)
        Of those that are driven; the others take those of what turns them.
    tops : mapping of int to ndarray of shape (F, 3)
        Places of controls that are moved freely.
    """
    turns = turns.copy()
    places = np.empty((*turns.shape[:2], 3))
    heads = rig.rest.heads
    for b, p in enumerate(rig.rest.parents):
        if not driven[b]:
            k = rig.turn_parents[b]
            turns[:, b] = turns[:, k] if k >= 0 else np.eye(3)
        if b in tops:
            places[:, b] = tops[b]
        elif p < 0:
            places[:, b] = heads[b]
        else:
            places[:, b] = places[:, p] + turns[:, p] @ (heads[b] - heads[p])
    return RigPoses(turns, places, driven)


def local_turns(rig: ControlRig, poses: RigPoses) -> Array:
    """Rotation of every control relative to where what turns it leaves it, shape (F, B, 3, 3): a pose bone's own."""
    R0 = rig.R_world_rest
    found = np.empty_like(poses.turns)
    for b, k in enumerate(rig.turn_parents):
        relative = poses.turns[:, b] if k < 0 else np.swapaxes(poses.turns[:, k], -1, -2) @ poses.turns[:, b]
        found[:, b] = R0[b].T @ relative @ R0[b]
    return found


def local_places(rig: ControlRig, poses: RigPoses, b: int) -> Array:
    """Location of a control along its axes as what turns it leaves them, shape (F, 3), armature's units."""
    p, k = rig.rest.parents[b], rig.turn_parents[b]
    start = rig.rest.heads[b]
    if p >= 0:
        start = poses.places[:, p] + poses.turns[:, p] @ (start - rig.rest.heads[p])
    axes = rig.location_axes[b] if k < 0 else poses.turns[:, k] @ rig.location_axes[b]
    return np.asarray(np.einsum("...ji,...j->...i", axes, poses.places[:, b] - start) / rig.scale)
