"""Types of arrays, as annotations name them, and where pieces of joined ones are."""

from collections.abc import Iterable
from itertools import accumulate, pairwise

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]
Ints = NDArray[np.int64]


def slices_of(counts: Iterable[int]) -> list[slice]:
    """Where pieces of these lengths are in the array that joins them."""
    return [slice(a, b) for a, b in pairwise(accumulate(counts, initial=0))]
