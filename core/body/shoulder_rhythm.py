"""Shoulders rise with raised arms: the rhythm of collar bone, shoulder blade and upper arm.

J. H. de Groot and R. Brand, A three-dimensional regression model of the shoulder rhythm, Clinical Biomechanics 16
(2001) 735-743, measured ten people in 23 positions of the arm: the collar bone rises by 0.123 degrees for every degree
of the upper arm's elevation. The shoulder blade, which carries the joint, hardly moves during the first 30 to 60
degrees (V. T. Inman, J. B. Saunders and L. C. Abbott, Observations on the function of the shoulder joint, Journal of
Bone and Joint Surgery 26 (1944) 1-30). The body has one part for both. It rises in proportion to how far up the arm
points: by as much as the collar bone in all, and little while the arm hangs.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..numerics.arrays import Array
from .body import Body
from .motion import Motion

RISE = 0.123 * np.pi / 2
"""Rise of a collar bone, radians, for each unit by which the upper arm's direction, a unit vector, points farther up:
from -1, hanging, to 1, upright, it rises by 0.123 times 180 degrees."""
_JOINTS = ("LShoulder", "RShoulder")
_ALONG = np.array([0.0, 1.0, 0.0])  # a bone, in its own frame


@dataclass(frozen=True, eq=False)
class ShoulderRhythm:
    """A collar bone and the upper arm that hangs on it.

    Attributes
    ----------
    collar, arm : int
        Indices of the two parts.
    up : ndarray, shape (3,)
        The body's upward direction in the frame of the part that carries the collar bone.
    raising : ndarray, shape (3,)
        Axis about which the collar bone turns when it rises, in its own frame at rest.
    """

    collar: int
    arm: int
    up: Array
    raising: Array

    def rise(self, body: Body, motion: Motion) -> RiseOfArm:
        """Return how far up the upper arm points on the F frames of a motion."""
        collar = body.R_parent_rest[self.collar] @ motion.rotations[:, self.collar]
        arm = body.R_parent_rest[self.arm] @ motion.rotations[:, self.arm]
        up = np.swapaxes(collar, -1, -2) @ self.up  # in the collar bone's frame
        along = arm @ _ALONG
        in_arm = np.einsum("fba,fb->fa", arm, up)
        return RiseOfArm(np.einsum("fa,fa->f", up, along), np.cross(along, up), np.cross(_ALONG, in_arm))


@dataclass(frozen=True, eq=False)
class RiseOfArm:
    """How far up an upper arm points on F frames.

    Attributes
    ----------
    values : ndarray, shape (F,)
        The upward component of its direction in the frame of the part that carries the collar bone, -1 to 1.
    by_collar, by_arm : ndarray, shape (F, 3)
        Derivatives by the increments of the collar bone's and of the upper arm's rotation.
    """

    values: Array
    by_collar: Array
    by_arm: Array


def shoulder_rhythms(body: Body) -> list[ShoulderRhythm]:
    """Return the shoulders of a body whose arms hang on stiff collar bones (`Body.is_stiff`); none for other bodies."""
    found = []
    for name in _JOINTS:
        arm = body.landmarks[name][0] if name in body.landmarks else 0
        collar = body.parents[arm]
        if collar <= 0 or not body.is_stiff[collar]:
            continue
        R_world = [body.parts[part].R_world_rest for part in (collar, body.parents[collar])]
        upward = np.array([0.0, 0.0, 1.0])
        raising = np.cross(_ALONG, R_world[0].T @ upward)
        if (length := float(np.linalg.norm(raising))) > 0:  # else the collar bone points up at rest
            found.append(ShoulderRhythm(collar, arm, R_world[1].T @ upward, raising / length))
    return found
