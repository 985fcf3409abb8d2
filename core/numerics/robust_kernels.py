"""Robust kernels, which limit the influence of outliers on a least-squares fit.

A kernel rho maps the squared norm s of a whitened residual to its cost. Iteratively reweighted least squares multiplies
the residual's rows by the weight rho'(s). See Z. Zhang, Parameter estimation techniques: a tutorial with application to
conic fitting, Image and Vision Computing 15 (1997), table 1, and B. Triggs et al., Bundle adjustment - a modern
synthesis (2000), section 3.3.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from .arrays import Array

NORMAL_MAD = 1.4826
"""Standard deviation of a normal error as a multiple of the median of its absolute values."""
RAYLEIGH_MEDIAN = 1.1774
"""Median length of a vector of two normal errors of standard deviation 1. A median length divided by this is a robust
estimate of the standard deviation."""


class RobustKernel(Protocol):
    """The cost of a residual by its squared norm, and the weight of its rows."""

    def cost(self, squared: Array) -> Array:
        """Cost rho(s) of squared norms, same shape; s itself near zero."""
        ...

    def weight(self, squared: Array) -> Array:
        """Weight rho'(s) of squared norms, same shape; 1 at zero."""
        ...


@dataclass(frozen=True)
class Quadratic:
    """No robustness: rho(s) = s."""

    def cost(self, squared: Array) -> Array:
        """Return the squared norms themselves."""
        return squared

    def weight(self, squared: Array) -> Array:
        """Return ones."""
        return np.ones_like(squared)


@dataclass(frozen=True)
class Huber:
    """Quadratic up to the limit k and linear beyond: rho(s) = 2 k sqrt(s) - k^2."""

    limit: float

    def cost(self, squared: Array) -> Array:
        """Cost rho(s), see `RobustKernel`."""
        k = self.limit
        return np.where(squared <= k * k, squared, 2 * k * np.sqrt(squared) - k * k)

    def weight(self, squared: Array) -> Array:
        """Weight rho'(s), see `RobustKernel`."""
        return self.limit / np.maximum(np.sqrt(squared), self.limit)


@dataclass(frozen=True)
class Cauchy:
    """Logarithmic growth: rho(s) = c^2 log(1 + s / c^2)."""

    scale: float

    def cost(self, squared: Array) -> Array:
        """Cost rho(s), see `RobustKernel`."""
        c2 = self.scale**2
        return np.asarray(c2 * np.log1p(squared / c2))

    def weight(self, squared: Array) -> Array:
        """Weight rho'(s), see `RobustKernel`."""
        return 1 / (1 + squared / self.scale**2)


@dataclass(frozen=True)
class GemanMcClure:
    """Bounded cost, so that far outliers do not count at all: rho(s) = s / (1 + s / c^2)."""

    scale: float

    def cost(self, squared: Array) -> Array:
        """Cost rho(s), see `RobustKernel`."""
        return squared / (1 + squared / self.scale**2)

    def weight(self, squared: Array) -> Array:
        """Weight rho'(s), see `RobustKernel`."""
        return np.asarray(1 / np.square(1 + squared / self.scale**2))
