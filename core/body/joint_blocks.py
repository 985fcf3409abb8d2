"""Normal equations of the parts' twists, mapped to those of the joints."""

from __future__ import annotations

import numpy as np

from ..numerics.arrays import Array
from ..numerics.banded_blocks import BandedBlocks
from .body import Body
from .kinematics import Poses, twist_jacobian


def joint_blocks(body: Body, poses: Poses, H: Array, g: Array, energy: float) -> BandedBlocks:
    """Map normal equations of twists to the degrees of freedom of a body.

    Parameters
    ----------
    body : Body
    poses : tuple
        (R, T) of its P parts, F frames.
    H, g : ndarray, shape (F, P, 6, 6) and (F, P, 6), or (F - 1, P, 12, 12) and (F - 1, P, 12)
        Of the twists on single frames, or on pairs of neighbouring frames, the earlier frame's six before the later's.
    energy : float
        Sum of the squared weighted residuals.
    """
    J = twist_jacobian(body, *poses)
    F, D = len(J), body.dof
    flat = J.reshape(F, -1, D)
    coupled = H.shape[-1] // 6
    rows = F + 1 - coupled
    blocks = BandedBlocks.zeros(F, D)
    for a in range(coupled):
        J_a = np.swapaxes(flat[a : rows + a], 1, 2)
        for b in range(a + 1):
            half = H[:, :, 6 * a : 6 * a + 6, 6 * b : 6 * b + 6] @ J[b : rows + b]
            band = blocks.diagonal[a : rows + a] if a == b else blocks.first
            band += J_a @ half.reshape(rows, -1, D)
        part = g[:, :, 6 * a : 6 * a + 6].reshape(rows, -1, 1)
        blocks.gradient[a : rows + a] += (J_a @ part)[..., 0]
    return BandedBlocks(blocks.diagonal, blocks.first, blocks.second, blocks.gradient, energy)
