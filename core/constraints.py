"""Constraints on motion beside the images: smoothness in time and key poses."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from . import rotations
from .motion import Motion

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class BandedBlocks:
    """A symmetric block-banded system over F frames of D degrees of freedom.

    Attributes
    ----------
    diagonal : ndarray, shape (F, D, D)
    first : ndarray, shape (F - 1, D, D)
        Block of frame j + 1 (rows) against frame j (columns).
    second : ndarray, shape (max(F - 2, 0), D, D)
        Block of frame j + 2 against frame j.
    gradient : ndarray, shape (F, D)
        Gradient of half the energy.
    energy : float
        Sum of squared weighted residuals.
    """

    diagonal: Array
    first: Array
    second: Array
    gradient: Array
    energy: float

    @classmethod
    def zeros(cls, frames: int, dof: int) -> BandedBlocks:
        return cls(
            np.zeros((frames, dof, dof)),
            np.zeros((max(frames - 1, 0), dof, dof)),
            np.zeros((max(frames - 2, 0), dof, dof)),
            np.zeros((frames, dof)),
            0.0,
        )

    def cut(self, start: int, stop: int) -> BandedBlocks:
        """The system of frames start to stop alone, the others held."""
        return BandedBlocks(
            self.diagonal[start:stop],
            self.first[start : stop - 1],
            self.second[start : max(stop - 2, start)],
            self.gradient[start:stop],
            self.energy,
        )

    def __add__(self, other: BandedBlocks) -> BandedBlocks:
        return BandedBlocks(
            self.diagonal + other.diagonal,
            self.first + other.first,
            self.second + other.second,
            self.gradient + other.gradient,
            self.energy + other.energy,
        )


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
    weights : ndarray, shape (D,)
        Inverse variance of the acceleration of each degree of freedom, 1/(m/frame^2)^2 and 1/(rad/frame^2)^2.
    expected : ndarray, shape (F - 2, D), optional
        Accelerations that cost nothing; by default none.
    """
    F, D = len(motion), len(weights)
    blocks = BandedBlocks.zeros(F, D)
    if F < 3:
        return blocks
    residual = acceleration(motion) - (0.0 if expected is None else expected)
    ahead, behind = _turns(motion.rotations)
    J_next = with_translation(rotations.right_jacobian_inverse(ahead))
    J_last = with_translation(rotations.right_jacobian_inverse(behind))
    J_here = -np.swapaxes(J_next + J_last, -1, -2)  # Jl^-1 is the transpose of Jr^-1
    J: list[Array] = [J_last, J_here, J_next]
    weighted: list[Array] = [weights.reshape(-1, 3, 1) * x for x in J]

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


def with_translation(J: Array, translation: Array | float = 1.0) -> Array:
    """The Jacobians of the translation, by a factor (N,), and of all parts' turns (N, P, 3, 3): (N, 1 + P, 3, 3)."""
    first = np.reshape(translation, (-1, 1, 1, 1)) * np.eye(3)
    return np.concatenate([np.broadcast_to(first, (len(J), 1, 3, 3)), J], axis=1)


def block_diagonal(J: Array) -> Array:
    """Jacobians of three degrees of freedom each (N, B, 3, 3) as those of all of them, (N, 3 B, 3 B)."""
    N, B = J.shape[:2]
    out, b = np.zeros((N, B, 3, B, 3)), np.arange(B)
    out[:, b, :, b] = np.swapaxes(J, 0, 1)
    return out.reshape(N, 3 * B, 3 * B)
