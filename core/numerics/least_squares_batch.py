"""Many small least-squares problems of the same size side by side, each by Levenberg-Marquardt with its own damping.

This is `least_squares` for problems so small that calls of functions would cost more than the computation. The method
is algorithm 3.16 of K. Madsen, H. B. Nielsen, O. Tingleff, Methods for non-linear least squares problems (2004), with
Marquardt's diagonal scaling.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from .arrays import Array

NormalSystems = tuple[Array, Array, Array]
"""Costs (n,), normal matrices (n, D, D) and gradients of half the costs (n, D) of n problems."""

_FIRST_DAMPING = 1e-3  # share of the diagonal
_MIN_DAMPING = 1e-12
_ROUNDING = 1e-12  # of a cost: steps that promise less cannot be tested


def minimise_each(
    start: Array,
    linearise: Callable[[Array, NDArray[np.intp]], NormalSystems],
    *,
    tolerance: float,
    evaluations: int,
) -> Array:
    """Minimise each of K sums of squares over D unknowns of its own.

    Parameters
    ----------
    start : ndarray, shape (K, D)
    linearise : callable
        Called with the unknowns (n, D) of some problems and the indices (n,) of these among the K; returns their
        normal systems.
    tolerance : float
        A problem is solved when the actual and the predicted decrease of its cost by a step are at most this share of
        the cost, or when the step is at most this share of the unknowns' norm.
    evaluations : int
        Largest number of evaluations for each problem.

    Returns
    -------
    ndarray, shape (K, D)
    """
    x = np.array(start, float)
    active = np.arange(len(x))
    cost, A, g = linearise(x, active)
    damping, growth = np.full(len(x), _FIRST_DAMPING), np.full(len(x), 2.0)
    diagonal = np.arange(x.shape[1])
    for _ in range(evaluations - 1):
        if not len(active):
            break
        damped = A[active]
        damped[:, diagonal, diagonal] *= 1 + damping[active, None]
        step = -np.linalg.solve(damped, g[active][..., None])[..., 0]
        promised = -np.einsum("kd,kd->k", step, 2 * g[active] + (A[active] @ step[..., None])[..., 0])
        there = linearise(x[active] + step, active)
        gain = cost[active] - there[0]
        better = gain >= 0
        share = np.where(better, gain / np.maximum(promised, 1e-300), 0.0)
        small = np.linalg.norm(step, axis=1) <= tolerance * np.linalg.norm(x[active], axis=1)
        least = np.maximum(tolerance, _ROUNDING) * cost[active]
        done = (better & (gain <= least) & (promised <= least)) | small | (promised <= _ROUNDING * cost[active])
        taken = active[better]
        x[taken] += step[better]
        for kept, new in zip((cost, A, g), there, strict=True):
            kept[taken] = new[better]
        shrink = np.clip(1 - (2 * np.minimum(share, 1.0) - 1) ** 3, 1 / 3, None)
        damping[active] = np.maximum(damping[active] * np.where(better, shrink, growth[active]), _MIN_DAMPING)
        growth[active] = np.where(better, 2.0, 2 * growth[active])
        active = active[~done]
    return x
