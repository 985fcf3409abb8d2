"""Rigs that a bone without a role, such as a root, has been posed to lean: their tilt.

Motion is upright whatever the rig leans by: rest poses are aligned as if it stood straight, and the poses found are
then expressed relative to the rig as it leans.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..body.skeleton_motion import RestSkeleton
from ..numerics.arrays import Array, Bools
from .bone_roles.roles import BoneMap
from .control_rig import ControlRig, RigPoses
from .rest_poses.rest_alignment import shortest_turn
from .retarget import Retargeted, grounded, way_up

_UP = np.array([0.0, 0.0, 1.0])
_LEAST = 1e-4  # sine of the least angle that counts as leaning


@dataclass(frozen=True, eq=False)
class RootTilt:
    """How a rig leans.

    Attributes
    ----------
    turn : ndarray, shape (3, 3)
        From upright to as it leans, in the world.
    pivot : ndarray, shape (3,)
        The point about which it leans, metres: that of its ground on which it stands.
    leaning : ndarray of bool, shape (B,)
        Controls that lean; others do not hang on what leans.
    """

    turn: Array
    pivot: Array
    leaning: Bools

    def straightened(self, rig: ControlRig, below: float) -> ControlRig:
        """Return the rig as it stands upright, for aligning rest poses, with its ground; see `grounded`. Its feet reach
        this far below its origin.
        """
        back = np.where(self.leaning[:, None, None], self.turn.T, np.eye(3))
        heads, tails = (
            self.pivot + np.einsum("bij,bj->bi", back, ends - self.pivot) for ends in (rig.rest.heads, rig.rest.tails)
        )
        rest = RestSkeleton(rig.rest.names, rig.rest.parents, heads, tails)
        return replace(
            rig,
            rest=grounded(rest, rig.bones, float(self.pivot[2]) - below),
            R_world_rest=back @ rig.R_world_rest,
            palms={side: back[rig.index(f"hand.{side}")] @ axes for side, axes in rig.palms.items()},
        )

    def _tilted(self, poses: RigPoses) -> RigPoses:
        turns = np.where(self.leaning[:, None, None], poses.turns @ self.turn.T, poses.turns)
        return replace(poses, turns=turns)

    def tilted(self, result: Retargeted) -> Retargeted:
        """Return poses of the straightened rig relative to the rest pose of the rig as it leans."""
        return replace(result, poses=self._tilted(result.poses), by_angles=self._tilted(result.by_angles))


def root_tilt(rig: ControlRig, turned: Array, pivot: Array) -> RootTilt | None:
    """Return how a rig leans; None if it does not, or stands upright only because it was turned.

    Parameters
    ----------
    rig : ControlRig
        As it leans.
    turned : ndarray, shape (B, 3, 3)
        By how much what has no role has turned the controls, in the world.
    pivot : ndarray, shape (3,)
        Where what has turned them has carried the rig's origin, metres.
    """
    swing = _tilt_of(turned[rig.index("hips")], way_up(rig.rest, rig.bones))
    if swing is None:
        return None
    return RootTilt(swing, pivot, np.abs(turned - np.eye(3)).max(axis=(1, 2)) > _LEAST)


def straight_turn(rest: RestSkeleton, bones: BoneMap, turned: Array) -> Array:
    """Return how a rig's rest pose is turned where it stands upright, (3, 3), by what turns its hips by `turned`."""
    swing = _tilt_of(turned, turned @ way_up(rest, bones))
    return turned if swing is None else swing.T @ turned


def _tilt_of(turned: Array, way: Array) -> Array | None:
    """Return how a rig that has been turned leans, (3, 3), None if it does not, or is only upright by that.

    Parameters
    ----------
    turned : ndarray, shape (3, 3)
    way : ndarray, shape (3,)
        From the knees to the shoulders.
    """
    swing = shortest_turn(_UP, turned @ _UP)
    if np.linalg.norm(swing[:2, 2]) < _LEAST or (swing.T @ way)[2] <= way[2]:
        return None
    return swing
