"""The controls of a target rig: their rest pose, and which control each of them follows."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from ..body.skeleton_motion import RestSkeleton
from ..numerics.arrays import Array, Bools
from .bone_roles.roles import FINGERS, BoneMap, parent_role

MOVED = ("root", "hips")
"""Roles of the bones that move through the world."""
_ON_THE_BONE_ABOVE = frozenset(["forearm", "hand", "shin", "foot", "toe", *FINGERS])
"""Roles whose bones hang on that of the role above; others may hang on any bone of the body."""


@dataclass(frozen=True, eq=False)
class ControlRig:
    """The B controls of a rig, parents before children.

    Attributes
    ----------
    rest : RestSkeleton
        The controls in the world frame, metres; the parent of a control is the one that determines its position.
    bones : BoneMap
        Their roles.
    turn_parents : tuple of int
        For each control, the one whose rotation it inherits; -1 if it inherits none.
    R_world_rest : ndarray, shape (B, 3, 3)
        Orientation at rest.
    location_axes : ndarray, shape (B, 3, 3)
        How each unit of a control's location channels moves it in the world at rest, metres, as columns. Only those of
        controls that play a role of `MOVED` and of those that are apart are used.
    toe_tips : mapping of str to float
        Horizontal distance at rest from the ankle to the tips of the toes, metres, 0 where it is unknown, for the sides
        ("L", "R") on which it is known from more than the foot's control, and the motion has no toes.
    palms : mapping of str to ndarray, shape (3, 3)
        By side, the axes of the palms at rest, see `rest_poses.palms.palm_axes`, where fingers that are
        not controlled show them.
    stiff_soles : mapping of str to ndarray, shape (V, 3)
        By side, the corners of the skin of feet whose toes have no bone: at rest, from the ankle, in the world's axes,
        metres.
    """

    rest: RestSkeleton
    bones: BoneMap
    turn_parents: tuple[int, ...]
    R_world_rest: Array
    location_axes: Array
    toe_tips: Mapping[str, float] = field(default_factory=dict)
    palms: Mapping[str, Array] = field(default_factory=dict)
    stiff_soles: Mapping[str, Array] = field(default_factory=dict)

    def index(self, role: str, place: int = 0) -> int:
        """Return the index of the control that plays a role; `place` counts along a chain."""
        return self.rest.indices([self.bones.bones[role][place]])[0]

    @cached_property
    def carriers(self) -> dict[int, int]:
        """Controls that are apart, as they hang on nothing that carries them, such as a foot on the rig's root; by
        each, the control that it belongs on.
        """
        return carriers_of_apart(self.rest, self.bones)


@dataclass(frozen=True, eq=False)
class RigPoses:
    """Poses of a rig's controls on F frames.

    Attributes
    ----------
    turns : ndarray, shape (F, B, 3, 3)
        Rotation from the rest orientation, in world axes.
    places : ndarray, shape (F, B, 3)
        Positions of the controls' heads in the world frame, metres.
    driven : ndarray of bool, shape (B,)
        Which controls are posed; the others only follow.
    """

    turns: Array
    places: Array
    driven: Bools

    def __len__(self) -> int:
        return len(self.turns)


def carriers_of_apart(rest: RestSkeleton, bones: BoneMap) -> dict[int, int]:
    """Return the bones of a body that are not carried by it, and the bone that each belongs on, see `ControlRig`."""
    body = {j for role in bones.bones if role != "root" for j in rest.indices(bones.bones[role])}
    found = {}
    for role, names in bones.bones.items():
        if role in MOVED:
            continue
        before = rest.indices(bones.bones[parent_role(role, bones.bones)])[-1]
        limb = role.partition(".")[0] in _ON_THE_BONE_ABOVE
        for j in rest.indices(names):
            above, p = set(), rest.parents[j]
            while p >= 0 and p not in above:
                above.add(p)
                p = rest.parents[p]
            if not above & ({before} if limb else body):
                found[j] = before
            before = j
    return found


def control_poses(rig: ControlRig, turns: Array, driven: Bools, tops: dict[int, Array]) -> RigPoses:
    """Return the poses of all controls (forward kinematics).

    Parameters
    ----------
    rig : ControlRig
    turns : ndarray, shape (F, B, 3, 3)
        World rotations of the driven controls; those of the others are ignored and follow from their turn parents.
    driven : ndarray of bool, shape (B,)
    tops : mapping of int to ndarray of shape (F, 3)
        World positions of the controls that are moved freely, metres.
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
        elif b in rig.carriers or p >= 0:
            p = rig.carriers.get(b, p)
            places[:, b] = places[:, p] + turns[:, p] @ (heads[b] - heads[p])
        else:
            places[:, b] = heads[b]
    return RigPoses(turns, places, driven)


def local_turns(rig: ControlRig, poses: RigPoses) -> Array:
    """Return every control's rotation relative to its turn parent, as in a pose bone's channels, shape (F, B, 3, 3)."""
    R0 = rig.R_world_rest
    found = np.empty_like(poses.turns)
    for b, k in enumerate(rig.turn_parents):
        relative = poses.turns[:, b] if k < 0 else np.swapaxes(poses.turns[:, k], -1, -2) @ poses.turns[:, b]
        found[:, b] = R0[b].T @ relative @ R0[b]
    return found


def local_places(rig: ControlRig, poses: RigPoses, b: int) -> Array:
    """Return the location channels of a control, whose axes its turn parent turns, shape (F, 3)."""
    p, k = rig.rest.parents[b], rig.turn_parents[b]
    start = rig.rest.heads[b]
    if p >= 0:
        start = poses.places[:, p] + poses.turns[:, p] @ (start - rig.rest.heads[p])
    axes = rig.location_axes[b] if k < 0 else poses.turns[:, k] @ rig.location_axes[b]
    return np.asarray(np.einsum("...ij,...j->...i", np.linalg.inv(axes), poses.places[:, b] - start))
