"""Normal equations of the parts' twists, mapped to those of the joints.

A degree of freedom moves all parts below its joint by the same twist. The entry of the normal matrix for two degrees of
freedom is therefore t1^T (sum of H) t2, with their twists t1 and t2, and the sum over the parts below both joints. If
one joint is an ancestor of the other, these are the parts below the lower one; otherwise there are none. This is the
composite rigid body algorithm (R. Featherstone, Rigid Body Dynamics Algorithms, 2008, section 6.2).
"""

from __future__ import annotations

import numpy as np

from ..numerics import rotations
from ..numerics.arrays import Array, Bools
from ..numerics.banded_blocks import BandedBlocks
from .body import Body
from .kinematics import Poses


def joint_blocks(body: Body, poses: Poses, H: Array, g: Array, energy: float) -> BandedBlocks:
    """Map normal equations of twists to the degrees of freedom of a body.

    Parameters
    ----------
    body : Body
    poses : tuple
        (R, T) of its P parts, F frames.
    H, g : ndarray, shape (F, P, 6, 6) and (F, P, 6), or (F - 1, P, 12, 12) and (F - 1, P, 12)
        Of the twists on single frames, or on pairs of neighbouring frames, the earlier frame's six before the later's;
        every H is symmetric.
    energy : float
        Sum of the squared weighted residuals.
    """
    R, T = poses
    F, D = len(T), body.dof
    coupled = H.shape[-1] // 6
    rows = F + 1 - coupled
    below, lower = _tree(body)
    upper_only = lower.T & ~lower
    H_below = (below @ H.reshape(rows, len(body), -1)).reshape(rows, len(below), *H.shape[2:])
    g_below = below @ g
    twists = np.zeros((F, len(below), 3, 6))  # of the translation and of every part's turn, about the world's origin
    twists[:, 0, :, :3] = np.eye(3)
    twists[:, 1:, :, 3:] = np.swapaxes(R, -1, -2)
    twists[:, 1:, :, :3] = np.swapaxes(rotations.skew(T) @ R, -1, -2)
    columns = np.ascontiguousarray(np.swapaxes(twists.reshape(F, D, 6), 1, 2))
    blocks = BandedBlocks.zeros(F, D)
    for a in range(coupled):
        of_a, own = slice(a, rows + a), slice(6 * a, 6 * a + 6)
        for b in range(a + 1):
            of_b, other = slice(b, rows + b), slice(6 * b, 6 * b + 6)
            # Rows of the lower joint against columns of those above it, and the other way round.
            found = (twists[of_a] @ H_below[:, :, own, other]).reshape(rows, D, 6) @ columns[of_b]
            found *= lower
            upper = found if a == b else (twists[of_b] @ H_below[:, :, other, own]).reshape(rows, D, 6) @ columns[of_a]
            upper = np.swapaxes(upper, 1, 2)
            np.copyto(found, upper, where=upper_only)
            band = blocks.diagonal[of_a] if a == b else blocks.first
            band += found
        blocks.gradient[of_a] += (twists[of_a] @ g_below[:, :, own, None]).reshape(rows, D)
    return BandedBlocks(blocks.diagonal, blocks.first, blocks.second, blocks.gradient, energy)


def _tree(body: Body) -> tuple[Array, Bools]:
    """Return the tree as two tables of bool.

    The first, (1 + P, P), says which parts are below each joint, where the translation counts as the first joint. The
    second, (D, D), says whether the joint of one degree of freedom is that of another, or below it.
    """
    P = len(body)
    below = np.concatenate([np.ones((1, P)), body.ancestry.T])
    above = np.zeros((1 + P, 1 + P), dtype=bool)
    above[:, 0], above[1:, 1:] = True, body.ancestry
    return below, np.repeat(np.repeat(above, 3, axis=0), 3, axis=1)
