"""Whether the light flickers: how much brightness swings from frame to frame, whatever moves in the pictures."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import cv2
import numpy as np
from numpy.typing import NDArray

FLICKER_FRAMES = 6
"""Number of consecutive frames that show it: lamps on the mains beat with frame rates within a few frames."""
MIN_FLICKER = 0.04
"""Amplitude that is said, relative: on footage in steady light it is below 0.01."""
_SIZE = 32, 18


def flicker(pictures: Sequence[NDArray[np.uint8]]) -> float:
    """Return the amplitude of the brightness of consecutive pictures about its trend, relative.

    The ratio of two pictures is the median over their blocks, most of which show what stands still.
    """
    blocks = [cv2.resize(p, _SIZE, interpolation=cv2.INTER_AREA).astype(float).mean(axis=-1) + 1 for p in pictures]
    steps = [np.median(np.log(after / before)) for before, after in pairwise(blocks)]
    level, number = np.r_[0.0, np.cumsum(steps)], np.arange(len(blocks))
    if len(level) < 4:
        return 0.0
    rest = level - np.polyval(np.polyfit(number, level, 1), number)
    return float(np.ptp(rest) / 2)
