"""The motion parameters of paper 1, section 2: steps from one pose to the next, and normal equations in them.

A step moves the pose that it leads to and all later poses.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ....body.motion import Motion
from ....numerics import rotations
from ....numerics.arrays import Array
from ....numerics.banded_blocks import BandedBlocks, block_diagonal, with_translation


@dataclass(frozen=True, eq=False)
class Steps:
    """Motion parameters x_j of one performer, j = 1 .. n.

    Attributes
    ----------
    shifts : ndarray, shape (n, 3)
        S_j, metres.
    turns : ndarray, shape (n, P, 3)
        Rotation vectors of Q_j, radians.
    """

    shifts: Array
    turns: Array

    @classmethod
    def of(cls, motion: Motion) -> Steps:
        """Return the motion parameters between n + 1 poses."""
        T, Q = motion.translations, motion.rotations
        return cls(np.diff(T, axis=0), rotations.log(np.swapaxes(Q[:-1], -1, -2) @ Q[1:]))

    def accumulated(self, start: Motion) -> Motion:
        """Accumulate the steps from the first pose of `start`, equations (6) and (7), to n + 1 poses."""
        turned = [start.rotations[0]]
        for Q in rotations.exp(self.turns):
            turned.append(turned[-1] @ Q)
        T = start.translations[0] + np.concatenate([np.zeros((1, 3)), np.cumsum(self.shifts, axis=0)])
        return Motion(T, rotations.orthonormal(np.stack(turned)))

    def vectors(self) -> Array:
        """Return the vectors x_j of equation (5), shape (n, D)."""
        return np.concatenate([self.shifts, self.turns.reshape(len(self.turns), 3 * self.turns.shape[1])], axis=1)


@dataclass(frozen=True, eq=False)
class StepEquations:
    """The gradient terms of the energy in one performer's motion parameters x_1 .. x_n, linearised around a motion.

    A step moves all later poses, so the spatio-temporal gradient constraints (12) of every later frame depend on it.
    The derivative (22) contains them all; equation (23), A_t,j x_j - b_t,j, only those of the step's own frame.

    Attributes
    ----------
    steps : ndarray, shape (n, D)
        The steps x of the motion.
    poses : BandedBlocks
        Normal equations in the increments of the n poses after the first, see `Motion.moved`.
    carried : ndarray, shape (n, D, D)
        Derivative of each pose's increments by those of the pose before, with the step between them fixed.
    curvature : ndarray, shape (n, D, D)
        Second derivative of the energy by each step.
    first, second : ndarray, shape (n, D, D)
        Derivative of the gradient by x_j with respect to increments of pose j - 1 and of pose j - 2, the poses after
        them being fixed.
    """

    steps: Array
    poses: BandedBlocks
    carried: Array
    curvature: Array
    first: Array
    second: Array

    @classmethod
    def of(cls, blocks: BandedBlocks, motion: Motion) -> StepEquations:
        """Convert normal equations in the increments of all n + 1 poses of a motion."""
        x = Steps.of(motion)
        carried = block_diagonal(with_translation(np.swapaxes(rotations.exp(x.turns), -1, -2)))
        poses = blocks.cut(1, len(motion))
        first, second = np.zeros_like(carried), np.zeros_like(carried)
        first[1:], second[2:] = poses.first, poses.second
        first[:-1] += np.swapaxes(carried[1:], 1, 2) @ second[1:]
        curvature = poses.diagonal.copy()
        for j in range(len(carried) - 1, 0, -1):
            across = carried[j].T @ first[j]
            curvature[j - 1] += across + across.T + carried[j].T @ curvature[j] @ carried[j]
        return cls(x.vectors(), poses, carried, curvature, first, second)

    @classmethod
    def printed(cls, A: Array, left: Array, motion: Motion) -> StepEquations:
        """Build them from A_t (n, D, D) and A_t x - b_t (n, D) of equation (23), as printed: each constraint depends on
        its own step alone.
        """
        back = block_diagonal(with_translation(np.swapaxes(rotations.exp(Steps.of(motion).turns), -1, -2)))
        across = np.swapaxes(back, 1, 2)
        blocks = BandedBlocks.zeros(len(motion), A.shape[-1])
        blocks.diagonal[1:] += A
        blocks.diagonal[:-1] += across @ A @ back
        blocks.first[:] -= A @ back
        blocks.gradient[1:] += left
        blocks.gradient[:-1] -= (across @ left[..., None])[..., 0]
        return cls.of(blocks, motion)

    def increments(self, x: Array) -> Array:
        """Increments of the n poses after the first, (n, D), that lead to steps x (n, D), to first order."""
        change = x - self.steps
        for j in range(1, len(change)):
            change[j] += self.carried[j] @ change[j - 1]
        return change

    def gradient(self, x: Array) -> Array:
        """Gradient by the steps, (n, D), at steps x (n, D)."""
        out = self.poses.gradient_at(self.increments(x))
        for j in range(len(out) - 1, 0, -1):
            out[j - 1] += self.carried[j].T @ out[j]
        return out
