"""Prior of poses: joints stay within their limits, and near their rest rotation if nothing else is known."""

from __future__ import annotations

import numpy as np

from ..numerics import rotations
from ..numerics.arrays import Array
from ..numerics.banded_blocks import BandedBlocks, block_diagonal
from .body import Body
from .motion import Motion

LIMIT_SIGMA = 0.05
"""Standard deviation of a joint beyond its limits, radians."""


def posture_prior(body: Body, motion: Motion, *, rest: bool = True) -> BandedBlocks:
    """Return the normal equations of joint limits and of deviations from rest.

    The weight of deviations from rest is divided by the number of frames, so that they count once for the whole motion.

    Parameters
    ----------
    body : Body
    motion : Motion
        F poses. The root is free.
    rest : bool
        Whether deviations from rest count; otherwise only limits do.
    """
    turns = rotations.log(motion.rotations[:, 1:])
    beyond = turns - np.clip(turns, body.limits[1:, :, 0], body.limits[1:, :, 1])
    stop, ease = (beyond != 0) / LIMIT_SIGMA**2, rest / (len(motion) * body.departures[1:, None] ** 2)
    energy = float(np.sum(stop * beyond**2 + ease * turns**2))
    return _turn_equations(turns, stop + ease, stop * beyond + ease * turns, energy)


def habitual_prior(motion: Motion, precision: Array, usual: Array) -> BandedBlocks:
    """Return the normal equations of a prior that parts have their usual rotations.

    Parameters
    ----------
    motion : Motion
        F poses.
    precision : ndarray, shape (F, P)
        Precision of each part's rotation from its usual one, 1/radians^2. The root is free.
    usual : ndarray, shape (P, 3, 3) or (F, P, 3, 3)
        The usual rotations.
    """
    parts = 1 + np.flatnonzero(precision[:, 1:].any(axis=0))
    turns = np.zeros((len(motion), precision.shape[1], 3))
    turns[:, parts] = rotations.log(np.swapaxes(usual[..., parts, :, :], -1, -2) @ motion.rotations[:, parts])
    turns, ease = turns[:, 1:], precision[:, 1:, None]
    return _turn_equations(turns, np.repeat(ease, 3, axis=2), ease * turns, float(np.sum(ease * turns**2)))


def _turn_equations(turns: Array, precision: Array, pull: Array, energy: float) -> BandedBlocks:
    """Normal equations of the rotation vectors (F, P - 1, 3) of all parts but the root."""
    F, D = len(turns), 6 + 3 * turns.shape[1]
    J = rotations.right_jacobian_inverse(turns)  # of the rotation vector by the joint's increment
    blocks = BandedBlocks.zeros(F, D)
    blocks.gradient[:, 6:] = np.einsum("fpra,fpr->fpa", J, pull).reshape(F, -1)
    H = np.einsum("fpra,fpr,fprb->fpab", J, precision, J)
    diagonal = block_diagonal(np.pad(H, ((0, 0), (2, 0), (0, 0), (0, 0))))
    return BandedBlocks(diagonal, blocks.first, blocks.second, blocks.gradient, energy)
