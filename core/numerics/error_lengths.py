"""How long errors in space are: the interval that holds a share of them."""

from __future__ import annotations

import numpy as np
from scipy.special import chdtr, fdtr

from .arrays import Array

_HALVINGS = 40


def length_quantile(
    covariances: Array, share: float, *, tails: float, gross: Array | None = None, gross_length: Array | None = None
) -> Array:
    """The length that a share of errors in space stay below.

    Errors have a multivariate t distribution about zero; some are gross ones instead, normal and alike in all
    directions. The squared length of a normal error is taken for a multiple of chi squared with the same mean and
    variance (F. Satterthwaite, An approximate distribution of estimates of variance components, Biometrics 2, 1946),
    which is exact where the error is alike in all directions, or along a line.

    Parameters
    ----------
    covariances : ndarray, shape (..., 3, 3)
        Scale matrices of the t distributions, metres squared; what is zero is certain.
    share : float
        Of all errors, 0 to 1.
    tails : float
        Degrees of freedom: how well the scale itself is known. Infinite for normal errors.
    gross : ndarray, shape (...), optional
        Share of gross errors, by default none.
    gross_length : ndarray, shape (...), optional
        Their root mean square length, metres.

    Returns
    -------
    ndarray, shape (...)
        Metres.
    """
    mean = np.maximum(np.trace(covariances, axis1=-2, axis2=-1), 0.0)
    squares = np.einsum("...ab,...ba->...", covariances, covariances)
    axes = np.clip(np.divide(mean**2, squares, out=np.full(mean.shape, 3.0), where=squares > 0), 1.0, 3.0)
    lost = np.zeros(mean.shape) if gross is None else gross
    far = np.zeros(mean.shape) if gross_length is None else gross_length

    def held(length: Array) -> Array:
        square = length**2 / np.maximum(mean, 1e-30)
        near = chdtr(axes, axes * square) if np.isinf(tails) else fdtr(axes, tails, square)
        return np.asarray((1 - lost) * near + lost * chdtr(3.0, 3 * length**2 / np.maximum(far, 1e-15) ** 2))

    low, high = np.zeros(mean.shape), np.sqrt(mean) + far + 1e-12
    while (short := held(high) < share).any():
        high = np.where(short, 2 * high, high)
    for _ in range(_HALVINGS):
        middle = (low + high) / 2
        short = held(middle) < share
        low, high = np.where(short, middle, low), np.where(short, high, middle)
    return np.where((mean > 0) | (lost > 1 - share), high, 0.0)
