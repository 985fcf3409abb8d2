"""Recognising interlaced video: a frame consists of two fields, and moving things are in two places, line by line."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

Image = NDArray[Any]

_MIN_DIFFERENCE = 72
"""Difference of neighbouring lines, summed over the colours, that is larger than noise, levels."""
_MAX_FIELD_DIFFERENCE = 0.5
"""Largest difference between the lines of one field, relative to that."""
_MIN_COMBED_PIXELS, _MIN_COMBED_SHARE = 60, 0.05
"""Number of combed pixels, and their fraction of all such steps, from which a video is interlaced: thin rods cause
some.
"""


def shows_two_fields(images: Sequence[Image], background: Image) -> bool:
    """Return whether a video is interlaced, from moving things on some of its frames.

    Parameters
    ----------
    images : sequence of ndarray of uint8, shape (h, w, 3)
    background : ndarray of uint8, shape (h, w, 3)
        The same picture without moving things.
    """
    combed = steps = 0
    for image in images:
        added = (image.astype(np.int16) - background).sum(axis=2, dtype=np.int32)
        a, b, c, d = added[:-3], added[1:-2], added[2:-1], added[3:]
        step = np.abs(b - a)
        comb = (step > _MIN_DIFFERENCE) & ((b - a) * (b - c) > 0)
        comb &= (np.abs(a - c) < _MAX_FIELD_DIFFERENCE * step) & (np.abs(b - d) < _MAX_FIELD_DIFFERENCE * step)
        combed, steps = combed + int(comb.sum()), steps + int((step > _MIN_DIFFERENCE).sum())
    return combed >= _MIN_COMBED_PIXELS and combed > _MIN_COMBED_SHARE * steps
