"""Smoothness of motion: normal equations of the accelerations of joints and of the root."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..numerics import rotations
from ..numerics.arrays import Array
from ..numerics.banded_blocks import BandedBlocks, block_diagonal, with_translation
from .motion import Motion


@dataclass(frozen=True, eq=False)
class SecondDifferences:
    """Second differences of a motion along time at frames 1 .. F - 2, the accelerations per frame squared.

    Attributes
    ----------
    values : ndarray, shape (F - 2, D)
        In metres and radians per frame squared. That of a rotation is log(Q_j^T Q_{j+1}) + log(Q_j^T Q_{j-1}): zero for
        a constant turn, and in the frame of Q_j.
    jacobians : tuple of ndarray, shape (F - 2, 1 + P, 3, 3)
        Derivatives by the increments of the frame before, the frame itself and the next. Only the blocks of the
        translation and of every part's rotation by itself are stored; all others are zero.
    """

    values: Array
    jacobians: tuple[Array, Array, Array]

    @classmethod
    def of(cls, motion: Motion, steps: Array | None = None) -> SecondDifferences:
        """Second differences of F >= 3 poses; `steps` as in `acceleration`."""
        ahead, behind = _turns(motion.rotations)
        J_next = with_translation(rotations.right_jacobian_inverse(ahead))
        J_last = with_translation(rotations.right_jacobian_inverse(behind))
        if steps is not None:
            before, after = (share[:, None, None, None] for share in _shares(steps))
            J_last, J_next = before * J_last, after * J_next
        J_here = -np.swapaxes(J_next + J_last, -1, -2)  # Jl^-1 is the transpose of Jr^-1
        return cls(_differences(motion.translations, ahead, behind, steps), (J_last, J_here, J_next))

    def normal_equations(self, weights: Array, expected: Array | None = None) -> BandedBlocks:
        """Normal equations of the weighted squared accelerations; parameters as in `smoothness`."""
        J, D = self.jacobians, self.values.shape[1]
        F = len(self.values) + 2
        blocks = BandedBlocks.zeros(F, D)
        residual = (self.values - (0.0 if expected is None else expected)).reshape(F - 2, -1, 3, 1)
        weighted = [_weighted(weights, x) for x in J]

        def product(a: int, b: int) -> Array:
            block: Array = np.swapaxes(J[a], -1, -2) @ weighted[b]
            return block_diagonal(block)

        for a in range(3):
            gradient = np.swapaxes(weighted[a], -1, -2) @ residual
            blocks.gradient[a : F - 2 + a] += gradient.reshape(F - 2, D)
            blocks.diagonal[a : F - 2 + a] += product(a, a)
        blocks.first[:-1] += product(1, 0)
        blocks.first[1:] += product(2, 1)
        blocks.second[:] = product(2, 0)
        energy = float(np.sum(residual * _weighted(weights, residual)))
        return BandedBlocks(blocks.diagonal, blocks.first, blocks.second, blocks.gradient, energy)

    def variances(self, band: tuple[Array, Array, Array]) -> Array:
        """Variances of the accelerations, shape (F - 2, D), from the covariance of the poses.

        Parameters
        ----------
        band : tuple of ndarray, shape (F, G, 3, 3), (F - 1, G, 3, 3) and (F - 2, G, 3, 3)
            The covariance of each frame's pose, and that with the next and the next but one, of every group of three
            degrees of freedom with itself; see `BandedFactor.covariance_band` and `diagonal_groups`.
        """
        at, near, far = band

        def part(a: int, C: Array, b: int) -> Array:
            return ((self.jacobians[a] @ C) * self.jacobians[b]).sum(axis=-1)

        alone = part(0, at[:-2], 0) + part(1, at[1:-1], 1) + part(2, at[2:], 2)
        joint = part(1, near[:-1], 0) + part(2, near[1:], 1) + part(2, far, 0)
        return np.maximum(alone + 2 * joint, 0).reshape(self.values.shape)


def _weighted(weights: Array, rows: Array) -> Array:
    """Multiply rows (F - 2, 1 + P, 3, k) with weights as in `smoothness`."""
    if weights.ndim == 4:
        return np.asarray(weights @ rows)
    return np.asarray(weights.reshape(*weights.shape[:-1], -1, 3, 1) * rows)


def acceleration(motion: Motion, steps: Array | None = None) -> Array:
    """Second differences along time at frames 1 .. F - 2, shape (F - 2, D); see `SecondDifferences`.

    Parameters
    ----------
    motion : Motion
        F poses.
    steps : ndarray, shape (F - 1,), optional
        The time from each pose to the next, frames; by default one. Second differences are divided differences then,
        which are zero for a constant velocity and unchanged where all steps are one.
    """
    return _differences(motion.translations, *_turns(motion.rotations), steps)


def _differences(T: Array, ahead: Array, behind: Array, steps: Array | None) -> Array:
    if steps is not None:
        before, after = (share[:, None, None] for share in _shares(steps))
        ahead, behind = after * ahead, before * behind
    return np.concatenate([second_differences(T, steps), (ahead + behind).reshape(len(T) - 2, -1)], axis=1)


def second_differences(values: Array, steps: Array | None) -> Array:
    """Second differences of values (F, ...) along time, shape (F - 2, ...); `steps` as in `acceleration`."""
    if steps is None:
        return np.asarray(values[2:] - 2 * values[1:-1] + values[:-2])
    before, after = (share.reshape(-1, *(1,) * (values.ndim - 1)) for share in _shares(steps))
    return np.asarray(before * (values[:-2] - values[1:-1]) + after * (values[2:] - values[1:-1]))


def _shares(steps: Array) -> tuple[Array, Array]:
    """Factors (F - 2,) of the differences to the pose before and to the next, in second divided differences."""
    before, after = steps[:-1], steps[1:]
    return 2 / (before * (before + after)), 2 / (after * (before + after))


def _turns(Q: Array) -> tuple[Array, Array]:
    middle = np.swapaxes(Q[1:-1], -1, -2)
    return rotations.log(middle @ Q[2:]), rotations.log(middle @ Q[:-2])


def smoothness(
    motion: Motion, weights: Array, expected: Array | None = None, steps: Array | None = None
) -> BandedBlocks:
    """Normal equations of the weighted squared accelerations.

    Parameters
    ----------
    motion : Motion
        F poses.
    weights : ndarray, shape (D,), (F - 2, D) or (F - 2, 1 + P, 3, 3)
        Inverse variance of the acceleration of each degree of freedom, 1/(m/frame^2)^2 and 1/(rad/frame^2)^2, or
        inverse covariances of those of the root's place and of each part's turn.
    expected : ndarray, shape (F - 2, D), optional
        Expected accelerations, which cost nothing; by default zero.
    steps : ndarray, shape (F - 1,), optional
        See `acceleration`.
    """
    if len(motion) < 3:
        return BandedBlocks.zeros(len(motion), 3 + 3 * motion.rotations.shape[1])
    return SecondDifferences.of(motion, steps).normal_equations(weights, expected)


MAX_STEP = 0.5
"""Largest rotation of a joint in one iteration, radians (and movement of the root, metres). Beyond it, the images'
gradients are meaningless."""


def limited(step: Array) -> Array:
    """Return the step (F, D) with the rotation of every joint (and the root's translation) limited to
    `MAX_STEP`.
    """
    turns = step.reshape(len(step), -1, 3)
    length = np.linalg.norm(turns, axis=-1, keepdims=True)
    return np.asarray((turns * np.minimum(1.0, MAX_STEP / np.maximum(length, 1e-12))).reshape(step.shape))
