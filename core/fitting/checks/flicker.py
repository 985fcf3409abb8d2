"""Whether the light flickers: how much brightness swings from frame to frame, whatever moves in the pictures.

Cameras that expose one row after the other show lamps on the mains as bands, which differ from frame to frame while the
mean brightness hardly does.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import cv2
import numpy as np
from numpy.typing import NDArray

from ...numerics.arrays import Array

FLICKER_FRAMES = 6
"""Number of consecutive frames that show it: lamps on the mains beat with frame rates within a few frames."""
MIN_FLICKER = 0.04
"""Amplitude that is said, relative: on footage in steady light, or whose exposure drifts, it is below 0.01."""
_MIN_FADE = 2.0
"""Ratio of brightness of the first and the last of these frames from which pictures fade, if all steps go one way."""
_SIZE = 32, 18


@dataclass(frozen=True)
class Flicker:
    """How much the brightness of consecutive pictures swings about its trend.

    Attributes
    ----------
    amplitude : float
        Of the rows of a picture, relative.
    in_bands : bool
        Whether rows swing one after the other, as in cameras that expose them so: no filter for whole pictures helps.
    fades : bool
        Whether the pictures only get much brighter, or darker, instead.
    """

    amplitude: float
    in_bands: bool
    fades: bool = False


def flicker(pictures: Sequence[NDArray[np.uint8]]) -> Flicker:
    """Measure how much the light flickers.

    The ratio of two pictures, or of a row of blocks in both, is the median over these blocks, most of which show what
    stands still.
    """
    blocks = [cv2.resize(p, _SIZE, interpolation=cv2.INTER_AREA).astype(float).mean(axis=-1) + 1 for p in pictures]
    if len(blocks) < 4:
        return Flicker(0.0, in_bands=False)
    steps = [np.log(after / before) for before, after in pairwise(blocks)]
    levels = np.array([[np.median(step)] for step in steps])
    if abs(levels.sum()) > np.log(_MIN_FADE) and len({*np.sign(levels[:, 0])}) == 1:
        return Flicker(0.0, in_bands=False, fades=True)
    whole = _swing(levels)
    rows = _swing(np.array([np.median(step, axis=1) for step in steps]))
    return Flicker(max(whole, rows), in_bands=rows > 2 * whole)


def _swing(steps: Array) -> float:
    """Return the median amplitude of M levels about their trends, from their steps, shape (n, M)."""
    levels, number = np.r_[np.zeros((1, steps.shape[1])), np.cumsum(steps, axis=0)], np.arange(len(steps) + 1)
    slope, start = np.polyfit(number, levels, 1)
    return float(np.median(np.ptp(levels - np.outer(number, slope) - start, axis=0)) / 2)
