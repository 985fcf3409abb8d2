"""A disc, swept along a ball's path and blurred, that is fitted to the shares of the ball's colour in pixels."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import ndtr

from ...numerics.arrays import Array, Bools
from ...numerics.least_squares import StoppingRule
from ...numerics.normal_equations import DenseEquations
from .free_unknowns import FreeUnknowns, centre_step

_BLUR_SIGMA = 1.3  # standard deviation of lens, sensor, colour subsampling and smoothing together, pixels
_HIDDEN_COSINE = 0.5  # cosine of the angle from a rod within which a ball may be hidden by it
_SHARE_NOISE = 0.06  # of a pixel's share of the ball's colour
_DIFFERENCES, _MAX_STEPS = np.full(5, 0.05), np.full(5, 0.5)  # pixels


@dataclass(frozen=True, eq=False)
class DiscEquations(DenseEquations):
    """The normal equations of a disc's unknowns, from the pixels `used` (h, w) and their residuals (n,)."""

    used: Bools
    residuals: Array


def _swept_discs(places: Array, x: Array) -> Array:
    """Return the share of blurred discs of radii x[:, 2] around x[:, :2], swept along x[:, 3:], at places (n, 2)."""
    off, path = places - x[:, None, :2], x[:, None, 3:]
    squared = (path**2).sum(axis=-1)
    along = np.where(squared > 1e-12, (off * path).sum(axis=-1) / np.maximum(squared, 1e-12), 0.0)
    apart = off - np.clip(along, -0.5, 0.5)[..., None] * path
    return np.asarray(ndtr((x[:, 2:3] - np.sqrt((apart**2).sum(axis=-1))) / _BLUR_SIGMA))


@dataclass(frozen=True, eq=False)
class DiscFit:
    """The fit of a swept disc to the shares of a ball's colour.

    Attributes
    ----------
    places : ndarray, shape (h, w, 2)
        Pixels.
    share : ndarray, shape (h, w)
        Of the ball's colour in each.
    ways : ndarray, shape (m, 2)
        Unit vectors from the ball's middle along the rods.
    unknowns : FreeUnknowns
        Five, see `_swept_discs`.
    """

    places: Array
    share: Array
    ways: Array
    unknowns: FreeUnknowns

    @classmethod
    def of(cls, places: Array, share: Array, ways: Array, *, start: Array, sigma: Array, free: Bools) -> DiscFit:
        """Return the fit from a start of its unknowns, their standard deviations, and which are free, (5,) each."""
        return cls(places, share, ways, FreeUnknowns(start, sigma, free, _DIFFERENCES, _MAX_STEPS))

    def used(self, x: Array) -> Bools:
        """Return which pixels the disc with the unknowns x (5,) reaches and no rod hides, shape (h, w)."""
        off = self.places - x[:2]
        distance = np.linalg.norm(off, axis=-1)
        along = np.einsum("vuk,mk->vum", off / np.maximum(distance, 1e-9)[..., None], self.ways)
        hidden = (along > _HIDDEN_COSINE).any(axis=-1) & (distance > 0.3 * x[2])
        return np.asarray((distance < x[2] + np.hypot(*x[3:]) / 2 + 2 * _BLUR_SIGMA) & ~hidden)

    def residuals(self, x: Array, used: Bools) -> Array:
        """Return by how much the shares of discs (k, 5) differ from those of n pixels, standard deviations, (k, n)."""
        return (_swept_discs(self.places[used], x) - self.share[used]) / _SHARE_NOISE

    def linearised(self, x: Array) -> DiscEquations:
        """Return the normal equations of the free unknowns at x, from the pixels that are used there."""
        used = self.used(x)
        values = self.residuals(self.unknowns.varied(x), used)
        now, J = values[0], self.unknowns.derivatives(values)
        H, g = self.unknowns.with_prior(x, J @ J.T, J @ now)
        return DiscEquations(H, g, float(now @ now) + self.unknowns.prior_cost(x), used, now)

    def trial_cost(self, x: Array, equations: DiscEquations) -> float:
        """Return the cost at x with the pixels of given equations."""
        off = self.residuals(x[None], equations.used)[0]
        return float(off @ off) + self.unknowns.prior_cost(x)

    def moved(self, x: Array, step: Array) -> Array:
        """Return the unknowns after a step."""
        after = self.unknowns.moved(x, step)
        after[2] = max(after[2], 0.5)
        return after


STOPPING = StoppingRule(iterations=8, small_step=2e-2, step_size=centre_step, small_refused=True)
"""The centre is known to a tenth of a pixel at best."""
