"""Poses in which left and right are exchanged, as in files whose sides are named from the camera's point of view."""

from __future__ import annotations

import numpy as np

from ..numerics.arrays import Array, Bools
from .body import Body
from .kinematics import landmark_positions
from .motion import Motion

_MAX_COSINE = -0.3
"""Cosine of the angle between a foot and the front of its shin, below which that foot points backwards: 0.90 and more
on 96 key poses of 18 shots, kicks and cartwheels among them; exchanged, -0.6 to -0.7, as the fit gives way."""
_LEG = ("Hip", "Knee", "Ankle", "BigToe")


def swapped_sides(body: Body, poses: Motion) -> Bools:
    """Return in which of K poses both feet point backwards, as far as the hips say where the front is, shape (K,).

    Whichever way a knee is bent, toes lie on the side of the shin that faces away from the calf: that of the right hip
    to the left hip's right, turned about the shin. Knees and ankles leave them there.
    """
    if not {side + joint for side in "LR" for joint in _LEG} <= body.landmarks.keys():
        return np.zeros(len(poses), bool)
    right, left = (_leg(body, poses, side) for side in "RL")
    across = right[0] - left[0]
    return np.asarray((_toe_forward(right, across) < _MAX_COSINE) & (_toe_forward(left, across) < _MAX_COSINE))


def _leg(body: Body, poses: Motion, side: str) -> Array:
    """Return the places of a leg's joints, shape (4, K, 3)."""
    return np.moveaxis(landmark_positions(body, poses, [side + joint for joint in _LEG]), 1, 0)


def _toe_forward(leg: Array, across: Array) -> Array:
    """Return the cosines (K,) between the foot of a leg (see `_leg`), at right angles to its shin, and the front of the
    shin, by the way across the hips, (K, 3).
    """
    _, knee, ankle, toe = leg
    shin, foot = ankle - knee, toe - ankle
    foot = foot - shin * ((foot * shin).sum(axis=1) / (shin**2).sum(axis=1))[:, None]
    front = np.cross(across, shin)
    return np.asarray((foot * front).sum(axis=1) / np.linalg.norm(foot, axis=1) / np.linalg.norm(front, axis=1))
