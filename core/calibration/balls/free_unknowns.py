"""What fits of a model to the pixels of a ball have in common: a prior, finite differences, and limited steps.

The model is an image computed from a few unknowns, of which only some can be seen. The others keep their start.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...numerics.arrays import Array, Bools


@dataclass(frozen=True, eq=False)
class FreeUnknowns:
    """The unknowns of a model, and which of them are solved for.

    Attributes
    ----------
    start, sigma : ndarray, shape (n,)
        The initial unknowns and their standard deviations, which are the prior.
    free : ndarray of bool, shape (n,)
        Which of them are solved for.
    difference : ndarray, shape (n,)
        Steps of the finite differences.
    furthest : ndarray, shape (n,)
        Largest change in one iteration.
    """

    start: Array
    sigma: Array
    free: Bools
    difference: Array
    furthest: Array

    def varied(self, x: Array) -> Array:
        """Return x, and x with each of k free unknowns moved by its difference, shape (1 + k, n)."""
        return np.concatenate([x[None], x + np.diag(self.difference)[self.free]])

    def derivatives(self, values: Array) -> Array:
        """Return the derivatives (k, m) of m residuals by the free unknowns, from those (1 + k, m) of `varied`."""
        return np.asarray((values[1:] - values[0]) / self.difference[self.free, None])

    def with_prior(self, x: Array, H: Array, g: Array) -> tuple[Array, Array]:
        """Return normal equations (k, k) and (k,) of the free unknowns at x with the prior added."""
        sigma = self.sigma[self.free]
        return H + np.diag(1 / sigma**2), g + self._off(x) / sigma

    def prior_cost(self, x: Array) -> float:
        """Return the squared distance of the free unknowns from their start, in standard deviations."""
        return float(self._off(x) @ self._off(x))

    def moved(self, x: Array, step: Array) -> Array:
        """Return the unknowns after a step (k,), of which no more than `furthest` is made."""
        after = x.copy()
        after[self.free] += np.clip(step, -self.furthest[self.free], self.furthest[self.free])
        return after

    def _off(self, x: Array) -> Array:
        return np.asarray(((x - self.start) / self.sigma)[self.free])


def centre_step(x: Array, after: Array) -> float:
    """Return by how much a step moves the centre, the first two unknowns of a ball, pixels."""
    return float(np.abs(after - x)[:2].max())
