"""Rotations of a body's parts from angles, as the motions use them. Needs no Blender."""

from __future__ import annotations

import numpy as np
from kfmocap.core.body import Body
from kfmocap.core.body.motion import Motion
from kfmocap.core.numerics.arrays import Array
from scipy.spatial.transform import Rotation

HEADING = np.pi / 2
"""The body's rest pose faces -Y; turned by this it faces +X."""


def turn(axes: str, *angles: Array) -> Rotation:
    """Rotation about the part's own axes, the first axis outermost; angles in radians, shape (F,) each."""
    return Rotation.from_euler(axes.upper(), np.stack(angles, axis=-1))


def hanging_arm(sign: float, swing: Array, drop: Array) -> Rotation:
    """Rotation of an upper arm lowered from the T pose and swung forward; sign is 1 on the left, -1 on the right.

    The bone's y axis points outwards and its z axis forwards: lowering it is a rotation about z, the swing one about
    the line through both shoulders, which is y of the arm in the T pose.
    """
    return turn("yz", -sign * swing, -sign * drop)


def posed_rotations(body: Body, turns: dict[str, Rotation], frames: int) -> Array:
    """Rotations Q of all parts, shape (F, P, 3, 3): the given ones, identity for the others."""
    Q = np.broadcast_to(np.eye(3), (frames, len(body), 3, 3)).copy()
    for name, turn in turns.items():
        Q[:, body.index(name)] = turn.as_matrix()
    return Q


def faced_about(body: Body, motion: Motion) -> Motion:
    """The motion turned by 180 degrees about the vertical through the world's origin."""
    half = np.diag([-1.0, -1.0, 1.0])
    Q = motion.rotations.copy()
    Q[:, 0] = body.R_parent_rest[0].T @ half @ body.R_parent_rest[0] @ Q[:, 0]
    return Motion(motion.translations @ half, Q)
