"""Small charts drawn by OpenCV."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..numerics.arrays import Array

Image = NDArray[Any]
Pair = tuple[float, float]
Colour = tuple[int, int, int]

PAPER, INK, GREY = (255, 255, 255), (40, 40, 40), (170, 170, 170)
"""Blue, green, red."""
_MARGINS = (50, 30, 20, 34)  # left, top, right, bottom
_FONT, _SIZE = cv2.FONT_HERSHEY_SIMPLEX, 0.45


def blank(width: int, height: int) -> Image:
    """Return an empty picture."""
    return np.full((height, width, 3), PAPER, np.uint8)


def text(picture: Image, words: str, place: Sequence[int], colour: Colour = INK) -> None:
    """Write words, their lower left at a place, pixels."""
    cv2.putText(picture, words, (int(place[0]), int(place[1])), _FONT, _SIZE, colour, 1, cv2.LINE_AA)


def heat_colour(share: float) -> Colour:
    """From blue (0) to red (1)."""
    level = np.uint8(np.clip(255 * share, 0, 255))
    blue, green, red = cv2.applyColorMap(np.array([[level]], np.uint8), cv2.COLORMAP_TURBO)[0, 0]
    return int(blue), int(green), int(red)


def stacked_pictures(rows: Sequence[Image]) -> Image:
    """Pictures one below the other, the narrower ones filled up."""
    width = max(row.shape[1] for row in rows)
    return np.vstack(
        [cv2.copyMakeBorder(r, 0, 0, 0, width - r.shape[1], cv2.BORDER_CONSTANT, value=PAPER) for r in rows]
    )


def joined_pictures(columns: Sequence[Image]) -> Image:
    """Pictures side by side, the lower ones filled up."""
    height = max(column.shape[0] for column in columns)
    return np.hstack(
        [cv2.copyMakeBorder(c, 0, height - c.shape[0], 0, 0, cv2.BORDER_CONSTANT, value=PAPER) for c in columns]
    )


def ticks(low: float, high: float, most: int = 6) -> Array:
    """Round numbers between two others."""
    rough = (high - low) / most
    power = 10.0 ** np.floor(np.log10(rough))
    step = power * next(s for s in (1, 2, 5, 10) if s * power >= rough)
    return np.asarray(np.arange(np.ceil(low / step - 1e-9), np.floor(high / step + 1e-9) + 1) * step + 0.0)


class Chart:
    """Axes to draw curves and bars into; `picture` is what was drawn."""

    def __init__(self, width: int, height: int, x: Pair, y: Pair, title: str) -> None:
        left, top, right, bottom = _MARGINS
        self.picture = blank(width, height)
        self._low, self._high = np.array([x[0], y[0]]), np.array([x[1], y[1]])
        self._corner, self._size = (
            np.array([left, height - bottom]),
            np.array([width - left - right, height - top - bottom]),
        )
        text(self.picture, title, (left, top - 10))
        for value in ticks(*x):
            u, v = self.place([value, y[0]])
            cv2.line(self.picture, (u, v), (u, v + 4), INK, 1)
            text(self.picture, f"{value:g}", (u - 8, v + 18))
        cv2.line(self.picture, self.place([x[0], y[0]]), self.place([x[1], y[0]]), INK, 1)

    def place(self, point: ArrayLike) -> Any:
        """Return the pixel of a point."""
        share = (np.asarray(point, float) - self._low) / (self._high - self._low)
        return (self._corner + share * self._size * [1, -1]).round().astype(np.int32)

    def line(self, x: ArrayLike, y: ArrayLike, colour: Colour) -> None:
        """A curve through points."""
        points = self.place(np.column_stack([x, y]))
        cv2.polylines(self.picture, [points], False, colour, 2, cv2.LINE_AA)

    def bars(self, edges: ArrayLike, heights: ArrayLike, colour: Colour) -> None:
        """Bars between edges."""
        e = np.asarray(edges, float)
        for a, b, height in zip(e[:-1], e[1:], np.asarray(heights, float), strict=True):
            cv2.rectangle(self.picture, self.place([a, 0]), self.place([b, height]), colour, -1)
