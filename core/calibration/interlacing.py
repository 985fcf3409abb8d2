"""Recognising interlaced video: its frames are woven of two fields, and what moves is in two places, line by line."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

Image = NDArray[Any]

_STEP = 72
"""Difference of neighbouring lines, summed over the colours, that noise does not make, levels."""
_ALIKE = 0.5
"""Share of that by which the lines of one field may differ."""
_FEWEST, _COMBED = 60, 0.05
"""Combed pixels, and their share of all such steps, from which on a video is interlaced: thin rods make some."""


def is_interlaced(images: Sequence[Image], background: Image) -> bool:
    """Whether a video is interlaced, by what moves on some of its frames.

    Parameters
    ----------
    images : sequence of ndarray of uint8, shape (h, w, 3)
    background : ndarray of uint8, shape (h, w, 3)
        Without what moves.
    """
    combed = steps = 0
    for image in images:
        added = (image.astype(np.int16) - background).sum(axis=2, dtype=np.int32)
        a, b, c, d = added[:-3], added[1:-2], added[2:-1], added[3:]
        step = np.abs(b - a)
        comb = (step > _STEP) & ((b - a) * (b - c) > 0)
        comb &= (np.abs(a - c) < _ALIKE * step) & (np.abs(b - d) < _ALIKE * step)
        combed, steps = combed + int(comb.sum()), steps + int((step > _STEP).sum())
    return combed >= _FEWEST and combed > _COMBED * steps
