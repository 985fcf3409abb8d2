"""Results that are the same on every processor.

Libraries of linear algebra sum in a different order on each kind of processor, so results differ in their last bits.
Such a difference becomes large when it decides on which side of an edge a pixel lies, or which of two solutions is
better. It is removed early: results of iterations are rounded to a grid that is much finer than their errors and much
coarser than rounding errors. Products in single precision, where many pixels depend on the last bit, are summed in a
fixed order.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .arrays import Array

GRID = 2.0**-17
"""Spacing of the grid for rotations in radians and positions in metres: 7.6 microradians or micrometres."""


def on_grid(values: Array) -> Array:
    """Round results of iterations to the grid, so that they are the same on every processor; same shape."""
    return np.asarray(np.rint(values / GRID) * GRID)


def transformed(matrices: NDArray[np.float32], points: NDArray[np.float32]) -> NDArray[np.float32]:
    """Products of matrices (m, r, k) and points (m, k, n) in single precision, (m, r, n), the same on every
    processor.
    """
    out = matrices[:, :, :1] * points[:, None, 0]
    term = np.empty_like(out)
    for k in range(1, matrices.shape[2]):
        out += np.multiply(matrices[:, :, k, None], points[:, None, k], out=term)
    return np.asarray(out)
