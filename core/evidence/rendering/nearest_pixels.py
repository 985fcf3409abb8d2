"""Looking up the pixels of images that are nearest to positions."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

_SMALL = np.dtype(np.int32), np.dtype(np.uint32)
_LARGE = np.dtype(np.int64), np.dtype(np.uint64)


def pixels_at(
    images: NDArray[Any],
    frame: NDArray[np.intp],
    u: NDArray[np.floating[Any]],
    v: NDArray[np.floating[Any]],
    beyond: Any,
) -> NDArray[Any]:
    """Look up the pixels of images that are nearest to positions.

    Parameters
    ----------
    images : ndarray, shape (n, h, w)
    frame : ndarray of int
        Index of the image of each position; broadcast to the shape of `u` and `v`.
    u, v : ndarray
        Positions, pixels.
    beyond : scalar
        Value for positions outside the image.

    Returns
    -------
    ndarray, shape of `u` and `v`
    """
    _, height, width = images.shape
    # Half as much to go through where it is enough.
    whole, unsigned = _SMALL if images.size < 1 << 31 else _LARGE
    with np.errstate(invalid="ignore"):  # NaN becomes a number far beyond all limits
        column, row = np.rint(u).astype(whole), np.rint(v).astype(whole)
    # As an unsigned number a negative one is large.
    inside = (column.view(unsigned) < width) & (row.view(unsigned) < height)
    index = row * whole.type(width)
    index += column
    index += (frame * (height * width)).astype(whole)
    index *= inside
    found = images.ravel().take(index)
    np.copyto(found, beyond, where=~inside)
    return np.asarray(found)
