"""Values that do not depend on the processor.

Libraries of linear algebra sum in another order on each kind of processor, so results differ in their last bits. Where
a pixel is on one side of an edge or the other, or one of two solutions is better, such a difference becomes a large
one. It is taken away before it can: what iterations lead to is put on a grid that is far finer than any error of it,
and far coarser than roundings; and single precision, whose last bit is many pixels' chance, is summed in one order.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .arrays import Array

GRID = 2.0**-17
"""Turns and places that are found are whole multiples of it, radians and metres: 8 micrometres."""


def on_grid(values: Array) -> Array:
    """Values that were found by iterations, on the grid: those of two processors are then the same."""
    return np.asarray(np.rint(values / GRID) * GRID)


def transformed(matrices: NDArray[np.float32], points: NDArray[np.float32]) -> NDArray[np.float32]:
    """Products of matrices (m, r, k) and points (m, k, n) in single precision, to the last bit, shape (m, r, n)."""
    out = matrices[:, :, :1] * points[:, None, 0]
    term = np.empty_like(out)
    for k in range(1, matrices.shape[2]):
        out += np.multiply(matrices[:, :, k, None], points[:, None, k], out=term)
    return np.asarray(out)
