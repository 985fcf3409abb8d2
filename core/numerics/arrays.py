"""Types of arrays for annotations, slices of concatenated arrays, and evenly spaced indices."""

from collections.abc import Iterable
from itertools import accumulate, pairwise

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]
Ints = NDArray[np.int64]


def slices_of(counts: Iterable[int]) -> list[slice]:
    """Return the slices of pieces with these lengths in the array that concatenates them."""
    return [slice(a, b) for a, b in pairwise(accumulate(counts, initial=0))]


def evenly_spaced(count: int, most: int) -> Ints:
    """Return the indices of at most so many of `count` elements, from the first to the last, evenly spaced."""
    return np.linspace(0, count - 1, min(most, count)).round().astype(np.int64)
