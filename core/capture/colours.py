"""Colours of marker balls: ranges of hue, saturation and value, named, picked or learned from one click."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from typing import Any

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import CalibrationError

Image = NDArray[Any]
Range = tuple[float, float]

_HUES = {"red": 0, "orange": 25, "yellow": 55, "green": 120, "cyan": 185, "blue": 225, "purple": 275, "magenta": 310}
"""Middle hues of the named colours, degrees."""
_NAMED_WIDTH = 25.0  # half the range of hues of a named colour, degrees
_NAMED_SATURATION = (0.5, 1.0)
_PICKED_WIDTH = 18.0  # half the range of hues of a picked colour, degrees
_STEPS = 255.0  # what OpenCV stores for hues of 360 degrees, and for saturations and values of 1
_WHOLE_HUE = (0.0, 360.0)
_MAX_HUE_WIDTH = 180.0
"""Width of a range of hues from which on it has no middle to speak of, degrees."""
MIN_RELATIVE_SATURATION = 0.5
"""Least saturation of small things, relative to that of the colour itself."""


@dataclass(frozen=True)
class Colour:
    """A range of colours: first and last hue, degrees, and the smallest and largest saturation and value, 0 to 1.

    A hue of (340, 20) goes through red.
    """

    hue: Range = _WHOLE_HUE
    saturation: Range = (0.4, 1.0)
    value: Range = (0.2, 1.0)

    def mask(self, hsv: Image) -> Image:
        """Return which pixels have this colour.

        Parameters
        ----------
        hsv : ndarray of uint8, shape (h, w, 3)
            The result of `to_hsv`.

        Returns
        -------
        ndarray of uint8, shape (h, w)
            255 for pixels of this colour, else 0.
        """
        (first, last), (s0, s1), (v0, v1) = self.hue, self.saturation, self.value
        first, last = (first, last) if last - first >= 360 else (first % 360, last % 360)
        spans = [(first, last)] if first <= last else [(first, 360.0), (0.0, last)]
        masks = [
            cv2.inRange(hsv, _levels(low / 360, s0, v0, np.floor), _levels(high / 360, s1, v1, np.ceil))
            for low, high in spans
        ]
        return np.asarray(masks[0] if len(masks) == 1 else cv2.bitwise_or(*masks))

    def paler(self) -> Colour:
        """Return the colour for small things, whose pixels mix it with a grey background."""
        return replace(
            self,
            saturation=(MIN_RELATIVE_SATURATION * self.saturation[0], self.saturation[1]),
            value=(0.0, self.value[1]),
        )

    def pure(self) -> NDArray[np.float64] | None:
        """Blue, green and red, 0 to 1, of the middle of its hues at full saturation; None where it is of any hue."""
        first, last = self.hue
        width = last - first if last >= first else last - first + 360
        if width >= _MAX_HUE_WIDTH:
            return None
        middle = np.array([[[_STEPS * ((first + width / 2) % 360) / 360, _STEPS, _STEPS]]])
        return np.asarray(cv2.cvtColor(middle.round().astype(np.uint8), cv2.COLOR_HSV2BGR_FULL)[0, 0] / _STEPS)


def _levels(hue: float, saturation: float, value: float, rounded: np.ufunc) -> tuple[int, int, int]:
    h, s, v = (int(np.clip(rounded(_STEPS * x), 0, _STEPS)) for x in (hue, saturation, value))
    return h, s, v


def to_hsv(image: Image) -> Image:
    """Convert a picture (h, w, 3), blue, green and red, to hue, saturation and value, each from 0 to 255."""
    return np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2HSV_FULL))


def parsed(value: object, where: str) -> Colour:
    """Parse a colour of a capture file.

    Parameters
    ----------
    value : str or mapping
        A name ("red"), a picked colour ("#d02010"), or ranges: {hue = [340, 20], saturation = [0.4, 1.0], value =
        [0.2, 1.0]}, hue in degrees; missing ranges have their usual width.
    where : str
        File and field, for error messages.

    Raises
    ------
    CalibrationError
        It is none of these.
    """
    if isinstance(value, str) and value.lower() in _HUES:
        centre = _HUES[value.lower()]
        return Colour(_around(centre, _NAMED_WIDTH), _NAMED_SATURATION)
    if isinstance(value, str) and (hexadecimal := re.fullmatch(r"#([0-9a-fA-F]{6})", value)):
        red, green, blue = bytes.fromhex(hexadecimal[1])
        return _picked(blue, green, red)
    if isinstance(value, Mapping):
        return _from_table(value, where)
    known = ", ".join(_HUES)
    todo = f'give a name ({known}), a picked colour such as "#d02010", or {{ hue = [340, 20] }}'
    raise CalibrationError(f"{value!r} is no colour", where=where, todo=todo)


def _around(hue: float, width: float) -> Range:
    return float((hue - width) % 360), float((hue + width) % 360)


def _picked(blue: int, green: int, red: int) -> Colour:
    """Return the range of colours of a ball from one of its pixels; others are darker or paler."""
    hue, saturation, value = to_hsv(np.array([[[blue, green, red]]], np.uint8))[0, 0] / _STEPS
    return Colour(_around(360 * float(hue), _PICKED_WIDTH), (0.5 * float(saturation), 1.0), (0.35 * float(value), 1.0))


def _from_table(table: Mapping[str, Any], where: str) -> Colour:
    known = [item.name for item in fields(Colour)]
    for key in table:
        if key not in known:
            raise CalibrationError(f"unknown key '{key}'", where=where, todo=f"there are {', '.join(known)}")
    ranges = {key: _range(pair, f"{where} {key}", 360.0 if key == "hue" else 1.0) for key, pair in table.items()}
    return Colour(**ranges)


def _range(pair: object, where: str, most: float) -> Range:
    try:
        low, high = (float(x) for x in pair)  # type: ignore[attr-defined]  # other things end in a TypeError
    except (TypeError, ValueError) as error:
        raise CalibrationError(f"{pair!r} is not a pair of numbers", where=where) from error
    if not (0 <= low <= most and 0 <= high <= most) or (most == 1.0 and low >= high):
        raise CalibrationError(f"{pair!r} is not a range within 0 and {most:g}", where=where)
    return low, high


def learned(image: Image, point: ArrayLike, tolerance: float = 15.0) -> Colour:
    """Learn the range of colours of a ball from a click on it.

    Parameters
    ----------
    image : ndarray of uint8, shape (h, w, 3)
        Blue, green, red.
    point : array-like, shape (2,)
        The clicked pixel.
    tolerance : float
        Largest difference in hue of the ball's pixels from the clicked one, degrees.

    Raises
    ------
    CalibrationError
        The point lies outside the picture, or on something grey.
    """
    height, width = image.shape[:2]
    u, v = (round(float(x)) for x in np.asarray(point, float))
    if not (0 <= u < width and 0 <= v < height):
        raise CalibrationError(f"({u}, {v}) is outside the picture of {width}x{height}")
    hsv = to_hsv(cv2.GaussianBlur(image, (3, 3), 0))
    seed = np.median(hsv[max(0, v - 1) : v + 2, max(0, u - 1) : u + 2].reshape(-1, 3), axis=0) / _STEPS
    hue, saturation = 360 * float(seed[0]), float(seed[1])
    if saturation < 0.15 or seed[2] < 0.1:
        raise CalibrationError(f"what is at ({u}, {v}) has no colour", todo="click on the ball's lit side")
    near = Colour(_around(hue, tolerance), (0.5 * saturation, 1.0), (0.08, 1.0))
    _, labels = cv2.connectedComponents(near.mask(hsv))
    of_ball = hsv[labels == labels[v, u]] / _STEPS if labels[v, u] else seed[None]
    apart = (360 * of_ball[:, 0] - hue + 180) % 360 - 180
    low, high = np.percentile(apart, [5, 95])
    s, lightness = np.percentile(of_ball[:, 1:], 5, axis=0)
    span = ((hue + float(low) - 8) % 360, (hue + float(high) + 8) % 360)
    return Colour(span, (0.8 * float(s), 1.0), (0.7 * float(lightness), 1.0))
