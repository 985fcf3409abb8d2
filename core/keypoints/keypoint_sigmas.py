"""The errors of keypoints: their standard deviations, and robust weights against outliers."""

from __future__ import annotations

import numpy as np

from ..numerics.arrays import Array
from ..numerics.robust_kernels import RAYLEIGH_MEDIAN, GemanMcClure

MIN_SIGMA = 0.006
"""Lower bound of the standard deviation of keypoints, metres."""
USUAL_SIGMA = 0.02
"""Standard deviation of keypoints that are seen too seldom to estimate it, metres."""
PRIOR_COUNT = 10.0
"""Weight of `USUAL_SIGMA` in each estimate, as a number of keypoints that are added to those found."""
LIFTED_SIGMA = 0.3
"""Standard deviation of depths that follow from the lengths of bones, metres. It is large because their errors last for
many frames, over which they do not average out."""
GEMAN_MCCLURE_SCALE = 3.0
"""Residual, in standard deviations, at which a keypoint has a quarter of its full weight (Geman and McClure's
kernel)."""


def sigmas(residuals: Array, confidence: Array) -> Array:
    """Robust standard deviations (V, L) of the keypoints over the frames, metres, from residuals (V, F, L, 2)."""
    return sigmas_of_lengths(np.linalg.norm(residuals, axis=-1), confidence)


def sigmas_of_lengths(lengths: Array, confidence: Array) -> Array:
    """Robust standard deviations as of `sigmas`, from the lengths of the residuals (V, F, L); NaN where none."""
    lengths = np.where(confidence > 0, lengths, np.nan)
    seen = np.isfinite(lengths).sum(axis=1)
    medians = np.nanquantile(np.where(seen[:, None] > 0, lengths, 0.0), 0.5, axis=1)
    own = np.nan_to_num(medians) / RAYLEIGH_MEDIAN
    mean = (seen * own + PRIOR_COUNT * USUAL_SIGMA) / (seen + PRIOR_COUNT)
    return np.asarray(np.maximum(mean, MIN_SIGMA))


def robust_energy(residuals: Array, confidence: Array, sigma: Array) -> float:
    """Return the sum of Geman and McClure's robust errors, in units of the variance.

    Parameters
    ----------
    residuals : ndarray, shape (V, F, L, 2)
        Metres. NaN where a keypoint was not found, or if its point is behind the camera; the latter has the full error.
    confidence : ndarray, shape (V, F, L)
    sigma : ndarray, shape (V, L)
        Metres.
    """
    kernel = GemanMcClure(GEMAN_MCCLURE_SCALE)
    error = np.sum(residuals**2, axis=-1) / sigma[:, None] ** 2
    return float(np.sum(confidence * np.where(np.isfinite(error), kernel.cost(error), kernel.scale**2)))


def robust_weights(residuals: Array, confidence: Array, sigma: Array, tolerance: float = 1.0) -> Array:
    """Return the weights of `robust_energy` in iteratively reweighted least squares, 1/m^2, shape (V, F, L); 0 for NaN.

    Parameters as in `robust_energy`.
    """
    error = np.sum(residuals**2, axis=-1) / sigma[:, None] ** 2
    weight = confidence * GemanMcClure(GEMAN_MCCLURE_SCALE * tolerance).weight(error) / sigma[:, None] ** 2
    return np.nan_to_num(weight)


def trusted_weights(residuals: Array, agreed: Array, sigma: Array, tolerance: float) -> Array:
    """Return Huber's weights, 1/m^2, shape (V, F, L), of keypoints that views agree on; 0 for NaN.

    Such keypoints are not outliers, however far the motion is from them at present. With Huber's weights they still
    pull from where Geman and McClure's weights would be close to zero.

    Parameters
    ----------
    residuals : ndarray, shape (V, F, L, 2)
    agreed : ndarray, shape (V, F, L)
        Confidence of the keypoints that agree with those of other views, else 0.
    sigma : ndarray, shape (V, L)
        Metres.
    tolerance : float
        Factor of the deviation, above 1 while the motion is far from the solution.
    """
    size = np.linalg.norm(residuals, axis=-1) / sigma[:, None]
    with np.errstate(invalid="ignore", divide="ignore"):
        huber = np.minimum(1.0, GEMAN_MCCLURE_SCALE * tolerance / size)
    return np.nan_to_num(agreed * huber / sigma[:, None] ** 2)
