"""From the levels of pictures to light, of which shares add up where a pixel shows two things."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from ..numerics.arrays import Array

GAMMA = 2.2
"""Approximate gamma of pictures: levels, 0 to 1, are light to the power of 1 / GAMMA."""


def linear_light(levels: ArrayLike) -> Array:
    """Return the light, 0 to 1, of levels from 0 to 255, same shape."""
    return np.asarray((np.asarray(levels, float) / 255) ** GAMMA)


LINEAR_LIGHT = linear_light(np.arange(256))
"""The light of each level."""
