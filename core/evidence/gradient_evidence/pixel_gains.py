"""How much likelier pixels are than if what they show stood still."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...numerics.arrays import Array
from .compared_pixels import ComparedPixels, LabelledFrames, compare

OUTLIER_SHARE = 0.05
"""Fraction of pixels whose brightness changes arbitrarily, because of occlusion or shading."""
MIN_NOISE = 2e-4
"""Least standard deviation of the noise of brightness, from 0 to 1."""
_MIN_SIGMA = 1e-3  # of the residuals of a frame whose pixels show next to nothing


@dataclass(frozen=True, eq=False)
class PixelGains:
    """Contributions to `GradientSums.gain` of the pixels of parts that stay in place, while others move in front of
    them.

    Attributes
    ----------
    here, there : ndarray of int, shape (N,)
        Indices of the pixels, and of their points one frame later, among all pixels of the n label images.
    frame, part : ndarray of int, shape (N,)
    gain : ndarray, shape (N,)
    """

    here: NDArray[np.intp]
    there: NDArray[np.intp]
    frame: NDArray[np.intp]
    part: NDArray[np.intp]
    gain: NDArray[np.floating[Any]]

    @classmethod
    def of(
        cls,
        frames: LabelledFrames,
        tolerance: float,
        noise: Array,
    ) -> PixelGains:
        """Return the gains of the parts in label images; parameters as in `brightness_constancy`."""
        compared, labels = compare(frames), frames.labels
        pixels, sigma = compared.pixels, tolerance * np.maximum(noise, MIN_NOISE)
        gain = gains(compared, sigma[pixels.frame, 0])
        kept = np.flatnonzero(compared.seen)
        _, height, width = labels.part.shape
        u, v = np.rint(compared.uv_there[kept].T / frames.stride).astype(np.intp)
        frame = pixels.frame[kept]
        there = ((frame + 1) * height + v) * width + u
        return cls(labels.index[: len(gain)][kept], there, frame, pixels.part[kept], gain[kept])

    def visible(self, part: NDArray[np.int16], numbers: NDArray[np.intp], pairs: int) -> Array:
        """Return the sums (m,) over the pixels that are visible on both frames in label images of all parts (n, h, w);
        `numbers` are the indices of these parts among all.
        """
        own, shown = numbers.astype(np.int16).take(self.part), part.ravel()
        hidden = shown.take(self.here) != own
        hidden |= shown.take(self.there) != own
        lost = np.flatnonzero(hidden)
        return self._sums(slice(None), pairs) - self._sums(lost, pairs)

    def _sums(self, of: slice | NDArray[np.intp], pairs: int) -> Array:
        return np.bincount(self.frame[of], self.gain[of], minlength=pairs).astype(float)


def gains(compared: ComparedPixels, sigma: NDArray[np.floating[Any]]) -> Array:
    """Return how much likelier each pixel is than if its point stood still, natural units, (N,); 0 for unused ones."""
    sigma = np.maximum(sigma, _MIN_SIGMA)
    moved, stood = (log_likelihoods(residual, sigma) for residual in (compared.residual, compared.standing))
    return np.asarray((moved - stood) * compared.seen)


def log_likelihoods(residual: NDArray[np.floating[Any]], sigma: NDArray[np.floating[Any]]) -> Array:
    """Return the log likelihoods of residuals, same shape, up to a constant: normal, or with probability
    `OUTLIER_SHARE` uniform.

    No single pixel can then cost more than an outlier. With Huber's loss, a pixel on an edge counts as much as eighty
    that are off by one standard deviation, and a few such pixels outweigh all else.
    """
    outliers = OUTLIER_SHARE / (1 - OUTLIER_SHARE) * np.sqrt(2 * np.pi) * sigma.astype(float)
    return np.asarray(np.log(np.exp(-0.5 * (residual.astype(float) / sigma) ** 2) + outliers))
