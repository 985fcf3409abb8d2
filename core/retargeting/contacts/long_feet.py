"""Feet that are long for their legs: their toes bend, as far as they can, where a straight foot would raise the ankle
on their tips, and then the heel comes down.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from ...body.skeleton_motion import RestSkeleton
from ...numerics.arrays import Array
from ..bone_roles.roles import SIDES, BoneMap
from ..rest_poses.rest_alignment import ankle_to_ball

LIKELY_FOOT = (0.8, 1.2)
"""Range of a foot's length, in proportion to the legs, within which that of its bone alone is believed to be it, and
toes that have no motion stay as they are posed.
"""
_LEAST_BEND = 0.05
"""Least of 1 - d^2 / l^2 of a leg that counts: a straight one would not bend at all."""


def long_feet(
    source: tuple[RestSkeleton, BoneMap], target: tuple[RestSkeleton, BoneMap], toe_tips: Mapping[str, float]
) -> list[str]:
    """Return the sides on which a target's foot has toes that the source lacks, and is long for its leg.

    Parameters
    ----------
    source, target : RestSkeleton and BoneMap
    toe_tips : mapping of str to float
        Distance from the target's ankle to the tips of its toes, by side.
    """
    found = []
    for side in SIDES:
        own = ankle_to_ball(*source, side)
        if own is None or side not in toe_tips or f"toe.{side}" not in target[1].bones:
            continue
        legs = [_thigh_and_shin(*rig, side) for rig in (target, source)]
        if toe_tips[side] * legs[1] > LIKELY_FOOT[1] * float(np.linalg.norm(own)) * legs[0]:
            found.append(side)
    return found


def _thigh_and_shin(rest: RestSkeleton, bones: BoneMap, side: str) -> float:
    joints = rest.heads[[rest.indices(bones.bones[f"{role}.{side}"])[0] for role in ("thigh", "shin", "foot")]]
    return float(np.linalg.norm(np.diff(joints, axis=0), axis=1).sum())


@dataclass(frozen=True, eq=False)
class Sole:
    """The sole of a foot at rest, relative to its ankle, in the world's axes, metres.

    Attributes
    ----------
    heel, tip : ndarray, shape (3,)
        Its ends, on the ground.
    joint : ndarray, shape (3,), optional
        Where its toes bend; None if they do not.
    """

    heel: Array
    tip: Array
    joint: Array | None = None

    @property
    def _axes(self) -> Array:
        """To the right, forward and up at rest, as columns (3, 3)."""
        forward = (self.tip - self.heel) * [1.0, 1.0, 0.0]
        forward = forward / np.linalg.norm(forward)
        up = np.array([0.0, 0.0, 1.0])
        return np.stack([np.cross(forward, up), forward, up], axis=1)

    def toe_bends(self, turns: Array, height: Array) -> Array:
        """Return by how much the toes must bend up for their tips not to be in the ground, at most until they are
        level, radians, shape (F,).

        Parameters
        ----------
        turns : ndarray, shape (F, 3, 3)
            Rotation of the foot from its rest pose.
        height : ndarray, shape (F,)
            Height of the ankle above the ground.
        """
        if self.joint is None:
            return np.zeros(len(turns))
        _, ahead, above = self._axes.T @ (self.tip - self.joint)
        rise, upright = (turns @ self._axes)[:, 2, 1:].T
        # The tip's height above the joint, bent by b, is A cos b + B sin b = C cos(b - g).
        A, B = ahead * rise + above * upright, ahead * upright - above * rise
        joint = height + (turns @ self.joint)[:, 2]
        wanted = np.clip(-joint / np.hypot(A, B), -1.0, 1.0)
        pitch = np.arctan2(-rise, upright)
        return np.clip(np.arctan2(B, A) - np.arccos(wanted), 0.0, np.maximum(pitch, 0.0))

    def bent(self, bends: Array) -> Array:
        """Return the rotations of the toes from the foot, (F, 3, 3), in the foot's axes at rest."""
        return np.asarray(Rotation.from_rotvec(bends[:, None] * self._axes[:, 0]).as_matrix())

    def ends(self, turns: Array, bends: Array) -> Array:
        """Return heel and tip relative to the ankle (F, 2, 3); the tip as low as the sole below the toes' joint."""
        tips = np.broadcast_to(self.tip, (len(turns), 3))
        found = np.einsum("fij,fcj->fci", turns, np.stack([np.broadcast_to(self.heel, tips.shape), tips], axis=1))
        if self.joint is not None and bends.any():
            tips = self.joint + self.bent(bends) @ (self.tip - self.joint)
            found[:, 1] = np.einsum("fij,fj->fi", turns, tips)
            below = np.einsum("fij,j->fi", turns, self._below_joint)[:, 2]
            found[:, 1, 2] = np.where(bends > 0, np.minimum(found[:, 1, 2], below), found[:, 1, 2])
        return found

    def carried(self, turns: Array, bends: Array, share: float) -> Array:
        """Return how far bent toes move the point of the sole at a share of the way from heel to tip, (F, 3): not at
        all where it is behind their joint.
        """
        point = self.heel + share * (self.tip - self.heel)
        if self.joint is None or (point - self.joint) @ self._axes[:, 1] <= 0:
            return np.zeros((len(turns), 3))
        ahead = point - self.joint
        return np.einsum("fij,fj->fi", turns, self.bent(bends) @ ahead - ahead)

    @property
    def _below_joint(self) -> Array:
        assert self.joint is not None
        return np.array([*self.joint[:2], self.tip[2]])

    def with_lower_heel(self, turns: Array, floor: Array, hip: Array, ankle: Array, leg: float) -> Array:
        """Return rotations (F, 3, 3) of the foot with the heel less far up where its ball would raise the ankle though
        its toes bend: on its tips, a long foot would bend a short leg.

        The sum of squared turns of foot, shin and thigh is least if the foot turns by k c h / (l^2 + k c^2), where h is
        how far the ankle would be raised, c the horizontal distance from ankle to ball, l the length of the leg, d that
        from hip to ankle, and k = 2 / (1 - d^2 / l^2).

        Parameters
        ----------
        turns : ndarray, shape (F, 3, 3)
        floor : ndarray, shape (F,)
            Least height of the ball.
        hip, ankle : ndarray, shape (F, 3)
            As joint angles have them.
        leg : float
            Its length.
        """
        bends = self.toe_bends(turns, ankle[:, 2] - floor)
        ways = self.ends(turns, bends)
        raised = floor - ways[:, 1, 2] - ankle[:, 2]
        c = np.linalg.norm(ways[:, 1, :2], axis=1)
        if self.joint is not None:
            c = np.where(bends > 0, np.linalg.norm((turns @ self._below_joint)[:, :2], axis=1), c)
        straight = np.linalg.norm(hip - ankle, axis=1) / leg
        k = 2 / np.maximum(1 - straight**2, _LEAST_BEND)
        along = np.einsum("fij,j->fi", turns, self.tip - self.heel)
        pitch = np.arctan2(-along[:, 2], np.linalg.norm(along[:, :2], axis=1))
        angle = np.clip(k * c * raised / (leg**2 + k * c**2), 0.0, np.maximum(pitch, 0.0))
        across = np.cross(along, [0.0, 0.0, 1.0])
        across /= np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-12)
        return np.asarray(Rotation.from_rotvec(angle[:, None] * across).as_matrix() @ turns)
