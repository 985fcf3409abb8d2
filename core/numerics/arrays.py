"""Types of arrays for annotations, slices of concatenated arrays, and runs of flags."""

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


def runs(flags: Bools) -> list[tuple[int, int]]:
    """Return the first and the last index of every run of true values in flags (F,)."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], flags, [False]]).astype(np.int8)))
    return [(int(a), int(b) - 1) for a, b in zip(edges[::2], edges[1::2], strict=True)]
