"""Prior of poses: joints stay within their limits, and near rest where nothing else is known."""

from __future__ import annotations

import numpy as np

from ..numerics import rotations
from ..numerics.banded_blocks import BandedBlocks, block_diagonal
from .body import Body
from .motion import Motion

LIMIT_DEVIATION = 0.05
"""How far a joint may go beyond its limits, radians."""
POSTURE_DEVIATION = 2.0
"""Usual departure of a joint from its rest orientation, radians: only decides what nothing else shows."""


def posture_prior(body: Body, motion: Motion, deviation: float = POSTURE_DEVIATION) -> BandedBlocks:
    """Return the normal equations of joint limits and of the departure from rest, which counts once per motion.

    Parameters
    ----------
    body : Body
    motion : Motion
        F poses. The root is free.
    deviation : float
        Usual departure from rest, radians; infinite for limits alone.
    """
    F, D = len(motion), body.dof
    blocks = BandedBlocks.zeros(F, D)
    turns = rotations.log(motion.rotations[:, 1:])
    beyond = turns - np.clip(turns, body.limits[1:, :, 0], body.limits[1:, :, 1])
    J = rotations.right_jacobian_inverse(turns)  # of the rotation vector by the joint's increment
    stop, ease = (beyond != 0) / LIMIT_DEVIATION**2, 1 / (F * deviation**2)
    H = np.einsum("fpra,fpr,fprb->fpab", J, stop + ease, J)
    g = np.einsum("fpra,fpr->fpa", J, stop * beyond + ease * turns)
    blocks.gradient[:, 6:] = g.reshape(F, -1)
    energy = float(np.sum(stop * beyond**2) + ease * np.sum(turns**2))
    diagonal = block_diagonal(np.pad(H, ((0, 0), (2, 0), (0, 0), (0, 0))))
    return BandedBlocks(diagonal, blocks.first, blocks.second, blocks.gradient, energy)
