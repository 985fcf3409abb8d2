"""Recognising interlaced video: a frame consists of two fields, and moving things are in two places, line by line."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

Image = NDArray[Any]

_MIN_DIFFERENCE, _NOISE_QUANTILE, _MIN_NOISE_RATIO = 72, 0.9, 4.0
"""Difference of neighbouring lines, summed over the colours, that is larger than noise: in levels, and in terms of this
quantile of the differences, to which noise adds most (six standard deviations): grain combs many of its steps.
"""
_MAX_FIELD_DIFFERENCE = 0.5
"""Largest difference between the lines of one field, relative to that."""
_MIN_COMBED_PIXELS, _MIN_WATCHED_PIXELS, _MIN_COMBED_SHARE = 60, 20, 0.05
"""Number of combed pixels, of all and of those that a `FieldWatch` looks at, and their fraction of all such steps, from
which a video is interlaced: thin rods cause some.
"""
_COLUMNS, _MAX_FRAMES, _MIN_APART = 160, 6, 6
"""Number of columns of a frame in which a `FieldWatch` looks, about, and of frames, and how far these are apart, at
least: each takes some milliseconds.
"""


class FieldWatch:
    """Looks for two fields in frames of a video that are given one by one, as they are stored.

    What the first of them shows, too, does not count: textures and blinds may have lines as fine as fields.
    """

    def __init__(self) -> None:
        self._first: Image | None = None
        self._combed = self._steps = 0
        self._seen: list[int] = []

    def add(self, image: Image, frame: int) -> None:
        """Look at a frame, shape (h, w, 3), blue, green, red, with its number; it is not kept, unless it is the first.

        Frames come in increasing order; those that are close to the one before are left out.
        """
        if len(self._seen) == _MAX_FRAMES or (self._seen and frame < self._seen[-1] + _MIN_APART):
            return
        self._seen.append(frame)
        columns = np.ascontiguousarray(image[:, :: max(1, image.shape[1] // _COLUMNS)])
        if self._first is None:
            self._first = columns.copy()
            return
        combed, steps = _combed_pixels(columns, self._first)
        self._combed, self._steps = self._combed + combed, self._steps + steps

    @property
    def interlaced(self) -> bool:
        """Whether moving things are in two places on these frames."""
        return self._combed >= _MIN_WATCHED_PIXELS and self._combed > _MIN_COMBED_SHARE * self._steps


def shows_two_fields(images: Sequence[Image], background: Image) -> bool:
    """Return whether a video is interlaced, from moving things on some of its frames.

    Parameters
    ----------
    images : sequence of ndarray of uint8, shape (h, w, 3)
    background : ndarray of uint8, shape (h, w, 3)
        The same picture without moving things.
    """
    found = [_combed_pixels(image, background) for image in images]
    combed, steps = (sum(counts) for counts in zip(*found, strict=True))
    return combed >= _MIN_COMBED_PIXELS and combed > _MIN_COMBED_SHARE * steps


def _combed_pixels(image: Image, background: Image) -> tuple[int, int]:
    """Return how many pixels of what is not background differ from both neighbouring lines, but not these from each
    other, and how many differ from the line before.
    """
    added = cv2.transform(image.astype(np.int16) - background, np.ones((1, 3))).astype(np.int32)
    a, b, c, d, e, f = (added[k : len(added) - 5 + k] for k in range(6))
    step = np.abs(c - b)
    clear = step > max(_MIN_DIFFERENCE, _MIN_NOISE_RATIO * float(np.quantile(step[::2], _NOISE_QUANTILE)))
    comb = clear & ((c - b) * (c - d) > 0)
    for one, next_of_its_field in ((a, c), (b, d), (c, e), (d, f)):
        comb &= np.abs(next_of_its_field - one) < _MAX_FIELD_DIFFERENCE * step
    return int(comb.sum()), int(clear.sum())
