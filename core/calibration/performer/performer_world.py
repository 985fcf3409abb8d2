"""The world of cameras that were found from a performer alone: z up from the floor."""

from __future__ import annotations

import numpy as np

from ...numerics.arrays import Array
from ...numerics.robust_kernels import Cauchy
from ..solving.camera_rig import Rig
from .limb_residuals import JOINTS, LIMB_ENDS, JointScene

LEVEL_SIGMA = np.radians(2.0)
"""How far a camera on a tripod usually leans to its side, radians."""
LEAN_SIGMA = np.radians(10.0)
"""How far a performer leans on the average of a shot, radians, each way."""
ANKLE_SHARE = 0.29
"""Height of an ankle above the floor as a share of the shin's length, for a foot that stands."""

_TILT_KERNEL_SCALE = 2.0
"""Scale of the kernel on what cameras lean, in standard deviations: some are turned on purpose, or propped up."""
_ROUNDS = 20  # of reweighting
_SHIN = list(LIMB_ENDS).index("shin")
_STANDING_SHARE = 0.25
"""Share of the frames on which the lower ankle is no higher than on the floor."""


def in_performers_world(scene: JointScene) -> Rig:
    """Return the cameras with z up, the floor at z = 0, the origin below the first frame's hips, x to the performer's
    left.

    The performer is taken to be upright on the average, and cameras to stand level unless they disagree with that; the
    floor lies below the lower ankle of the frames on which it is low.
    """
    joint = {name: scene.joints_world[:, j] for j, name in enumerate(JOINTS)}
    up = _up(scene.rig, joint)
    hips = _middle(joint["RHip"], joint["LHip"])
    first = int(np.flatnonzero(np.isfinite(hips).all(axis=1))[0]) if np.isfinite(hips).any() else 0
    left = joint["LHip"][first] - joint["RHip"][first]
    if not np.isfinite(left).all() or np.linalg.norm(left - (left @ up) * up) < 1e-6:
        left = scene.rig.R_cam_world[0, 0]
    left = left - (left @ up) * up
    left /= np.linalg.norm(left)
    R = np.stack([left, np.cross(up, left), up])
    ankles = np.stack([joint["RAnkle"], joint["LAnkle"]]) @ up
    lower = np.where(np.isfinite(ankles), ankles, np.inf).min(axis=0)
    lower = lower[np.isfinite(lower)]
    floor = (np.quantile(lower, _STANDING_SHARE) if len(lower) else 0.0) - ANKLE_SHARE * scene.lengths[_SHIN]
    origin = np.nan_to_num(hips[first])
    t = -R @ origin
    t[2] = -floor
    return scene.rig.in_world(R, t)


def _up(rig: Rig, joint: dict[str, Array]) -> Array:
    """Return the upward unit vector by the performer's trunk and legs, and by the rows of those cameras that stand
    level.
    """
    feet, shoulders = _middle(joint["RAnkle"], joint["LAnkle"]), _middle(joint["RShoulder"], joint["LShoulder"])
    tall = shoulders - feet
    tall = tall[np.isfinite(tall).all(axis=1)]
    down = rig.R_cam_world[:, 1].mean(axis=0)
    tall = tall / np.linalg.norm(tall, axis=1, keepdims=True) if len(tall) else -down[None]
    body = np.linalg.eigh(tall.T @ tall)[1][:, -1]  # whichever way round: some stand on their hands
    body *= -np.sign(body @ down)
    lean = LEAN_SIGMA**2 + np.mean(1 - (tall @ body) ** 2)  # who bends or lies in between says less
    upright = (np.eye(3) - np.outer(body, body)) / lean
    rows, up, kernel = rig.R_cam_world[:, 0], body, Cauchy(_TILT_KERNEL_SCALE)
    for _ in range(_ROUNDS):
        weight = kernel.weight((rows @ up / LEVEL_SIGMA) ** 2) / LEVEL_SIGMA**2
        up = np.linalg.eigh(upright + (weight * rows.T) @ rows)[1][:, 0]
        up *= np.sign(up @ body)
    return np.asarray(up)


def _middle(one: Array, other: Array) -> Array:
    return np.asarray((one + other) / 2)
