"""Quantiles of the lengths of errors in space, from their covariances."""

from __future__ import annotations

import numpy as np
from scipy.special import chdtr, fdtr

from .arrays import Array

_HALVINGS = 40  # of the interval that contains the quantile


def length_quantile(
    covariances: Array, share: float, *, tails: float, gross: Array | None = None, gross_length: Array | None = None
) -> Array:
    """Return the length below which a given share of errors in space stay.

    Errors have a multivariate t distribution about zero, mixed with a share of gross errors, which are normal and
    isotropic. The squared length of a normal error is approximated by a multiple of a chi-squared variable with the
    same mean and variance (F. Satterthwaite, An approximate distribution of estimates of variance components,
    Biometrics 2, 1946). This is exact for errors that are isotropic, or along a line.

    Parameters
    ----------
    covariances : ndarray, shape (..., 3, 3)
        Scale matrices of the t distributions, metres squared; zero for an exact position.
    share : float
        The share of all errors, 0 to 1.
    tails : float
        Degrees of freedom of the t distribution: how well the scale itself is known. Infinite for normal errors.
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
