"""From the twists of the parts to degrees of freedom: normal equations of parts mapped to those of joints."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..numerics.banded_blocks import BandedBlocks
from .body import Body
from .kinematics import Poses, twist_jacobian

Array = NDArray[np.float64]


def joint_blocks(body: Body, poses: Poses, H: Array, g: Array, energy: float) -> BandedBlocks:
    """Map twists to degrees of freedom.

    Parameters
    ----------
    body : Body
    poses : tuple
        (R, T) of its P parts, F frames.
    H, g : ndarray, shape (F - 1, P, 12, 12) and (F - 1, P, 12)
        Sums over the views of this body's parts.
    """
    J = twist_jacobian(body, *poses)
    F, D = len(J), body.dof
    flat = J.reshape(F, -1, D)
    blocks = BandedBlocks.zeros(F, D)
    for a in range(2):
        J_a = flat[a : F - 1 + a]
        for b in range(a + 1):
            half = H[:, :, 6 * a : 6 * a + 6, 6 * b : 6 * b + 6] @ J[b : F - 1 + b]
            block = np.swapaxes(J_a, 1, 2) @ half.reshape(F - 1, -1, D)
            (blocks.diagonal[a : F - 1 + a] if a == b else blocks.first)[:] += block
        part = g[:, :, 6 * a : 6 * a + 6].reshape(F - 1, -1, 1)
        blocks.gradient[a : F - 1 + a] += (np.swapaxes(J_a, 1, 2) @ part)[..., 0]
    return BandedBlocks(blocks.diagonal, blocks.first, blocks.second, blocks.gradient, energy)


def single_blocks(body: Body, poses: Poses, H: Array, g: Array, energy: float) -> BandedBlocks:
    """Map the twists of single frames to degrees of freedom.

    Parameters
    ----------
    body : Body
    poses : tuple
        (R, T) of its P parts, F frames.
    H, g : ndarray, shape (F, P, 6, 6) and (F, P, 6)
        Sums over the views of this body's parts.
    """
    J = twist_jacobian(body, *poses)
    F, D = len(J), body.dof
    J_t = np.swapaxes(J.reshape(F, -1, D), 1, 2)
    zero = BandedBlocks.zeros(F, D)
    diagonal, gradient = J_t @ (H @ J).reshape(F, -1, D), (J_t @ g.reshape(F, -1, 1))[..., 0]
    return BandedBlocks(diagonal, zero.first, zero.second, gradient, energy)
