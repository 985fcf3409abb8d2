"""Smoothness of motion: accelerations of joints and of the root, and what they cost."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..numerics import rotations
from ..numerics.banded_blocks import BandedBlocks, block_diagonal, with_translation
from .motion import Motion

Array = NDArray[np.float64]


def acceleration(motion: Motion) -> Array:
    """Second differences along time at frames 1 .. F - 2, shape (F - 2, D).

    Of a rotation it is log(Q_j^T Q_{j+1}) + log(Q_j^T Q_{j-1}): zero for a constant turn, and in the frame of Q_j.
    """
    T, Q = motion.translations, motion.rotations
    ahead, behind = _turns(Q)
    return np.concatenate([T[2:] - 2 * T[1:-1] + T[:-2], (ahead + behind).reshape(len(T) - 2, -1)], axis=1)


def _turns(Q: Array) -> tuple[Array, Array]:
    middle = np.swapaxes(Q[1:-1], -1, -2)
    return rotations.log(middle @ Q[2:]), rotations.log(middle @ Q[:-2])


def smoothness(motion: Motion, weights: Array, expected: Array | None = None) -> BandedBlocks:
    """Normal equations of the weighted squared accelerations.

    Parameters
    ----------
    motion : Motion
        F poses.
    weights : ndarray, shape (D,) or (F - 2, D)
        Inverse variance of the acceleration of each degree of freedom, 1/(m/frame^2)^2 and 1/(rad/frame^2)^2.
    expected : ndarray, shape (F - 2, D), optional
        Accelerations that cost nothing; by default none.
    """
    F, D = len(motion), weights.shape[-1]
    blocks = BandedBlocks.zeros(F, D)
    if F < 3:
        return blocks
    residual = acceleration(motion) - (0.0 if expected is None else expected)
    ahead, behind = _turns(motion.rotations)
    J_next = with_translation(rotations.right_jacobian_inverse(ahead))
    J_last = with_translation(rotations.right_jacobian_inverse(behind))
    J_here = -np.swapaxes(J_next + J_last, -1, -2)  # Jl^-1 is the transpose of Jr^-1
    J: list[Array] = [J_last, J_here, J_next]
    weighted: list[Array] = [weights.reshape(*weights.shape[:-1], -1, 3, 1) * x for x in J]

    def product(a: int, b: int) -> Array:
        block: Array = np.swapaxes(J[a], -1, -2) @ weighted[b]
        return block_diagonal(block)

    for a in range(3):
        gradient = np.swapaxes(weighted[a], -1, -2) @ residual.reshape(F - 2, -1, 3, 1)
        blocks.gradient[a : F - 2 + a] += gradient.reshape(F - 2, D)
        blocks.diagonal[a : F - 2 + a] += product(a, a)
    blocks.first[:-1] += product(1, 0)
    blocks.first[1:] += product(2, 1)
    blocks.second[:] = product(2, 0)
    energy = float(np.sum(weights * residual**2))
    return BandedBlocks(blocks.diagonal, blocks.first, blocks.second, blocks.gradient, energy)


LONGEST_STEP = 0.5
"""No joint turns farther than this in one iteration, radians: beyond it the images' gradients say nothing."""


def limited(step: Array) -> Array:
    """A step with every joint's part of it cut to `LONGEST_STEP`."""
    turns = step.reshape(len(step), -1, 3)
    length = np.linalg.norm(turns, axis=-1, keepdims=True)
    return np.asarray((turns * np.minimum(1.0, LONGEST_STEP / np.maximum(length, 1e-12))).reshape(step.shape))
