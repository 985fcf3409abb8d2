"""Smoothed frames with their derivatives, sampled at any place: the same to the last bit on every processor."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from ..runtime.processes.shared_arrays import each_row

Image = NDArray[np.float32]

_ROW = 256
_STEPS = 1 << cv2.INTER_BITS


_KERNEL_BITS = 12
"""The weights of a kernel are integers whose sum is two to this power."""
_WHITE = 255 << 8
"""Value of white in a smoothed image."""


def _whole_gaussian(sigma: float) -> Image:
    """Gaussian kernel with integer weights, shape (2 n + 1,)."""
    half = max(1, round(4 * sigma))
    tail = np.rint(cv2.getGaussianKernel(2 * half + 1, sigma)[:half, 0] * 2**_KERNEL_BITS)
    return np.concatenate([tail, [2**_KERNEL_BITS - 2 * tail.sum()], tail[::-1]]).astype(np.float32)


def _smoothed(image: NDArray[np.uint8], kernel: Image) -> Image:
    """Smooth an 8-bit image; the result has integer values up to `_WHITE`.

    All sums are integers below 2^24, which single precision represents exactly, so processors that add in another order
    give the same image to the last bit. Differences would be amplified by solving.
    """
    one = np.ones(1, np.float32)
    kernel = kernel * np.float32(2.0 ** (4 - _KERNEL_BITS))  # sums stay exact: it only moves their point
    across = cv2.sepFilter2D(image, cv2.CV_32F, kernel, one)
    down = cv2.sepFilter2D(np.rint(across, out=across), cv2.CV_32F, one, kernel)
    return np.rint(down, out=down)


def _brightness_and_slopes(image: NDArray[np.uint8], kernel: Image) -> tuple[Image, Image, Image]:
    """Smooth an 8-bit image to brightness 0 to 1, and differentiate it by u and v, per pixel."""
    smooth = _smoothed(image, kernel)
    du, dv = (cv2.Scharr(smooth, cv2.CV_32F, *order, scale=1 / 32) for order in ((1, 0), (0, 1)))
    for values in (smooth, du, dv):  # while they are in the cache
        np.multiply(values, np.float32(1 / _WHITE), out=values)
    return smooth, np.asarray(du, np.float32), np.asarray(dv, np.float32)


def smoothed_slopes(grey: NDArray[np.uint8], sigma: float) -> Iterator[tuple[Image, Image]]:
    """Generate the derivatives by u and v, (h, w) each, of 8-bit images (n, h, w) smoothed by a Gaussian of `sigma`
    pixels; in brightness 0 to 1 per pixel.
    """
    kernel = _whole_gaussian(sigma)
    for image in each_row(grey):
        yield _brightness_and_slopes(image, kernel)[1:]


@dataclass(frozen=True, eq=False)
class SmoothedImages:
    """Smoothed brightness (0 to 1), with or without its derivatives per pixel, in a window of n frames.

    Attributes
    ----------
    values : ndarray, shape (n h, w, C)
        Brightness, and, if C is 3, its derivatives by u and v; the windows of the frames are stacked vertically.
    count : int
        The number of frames, n.
    origin : tuple of int
        Pixel (u, v) of the frames that is the first one of the window.
    """

    values: Image
    count: int
    origin: tuple[int, int] = (0, 0)

    @classmethod
    def brightness(cls, grey: NDArray[np.uint8], sigma: float, origin: tuple[int, int] = (0, 0)) -> SmoothedImages:
        """Smooth windows of 8 bits (n, h, w) by a Gaussian of `sigma` pixels, all at once: within four sigma of its
        upper and lower edges a window shows something of others.
        """
        values = _smoothed(np.ascontiguousarray(grey).reshape(-1, grey.shape[2]), _whole_gaussian(sigma))
        np.multiply(values, np.float32(1 / _WHITE), out=values)
        return cls(values[..., None], len(grey), origin)

    @classmethod
    def with_gradients(cls, grey: NDArray[np.uint8], sigma: float, origin: tuple[int, int] = (0, 0)) -> SmoothedImages:
        """Smooth windows as `brightness` does, and differentiate them."""
        values = np.empty((*grey.shape, 3), np.float32)
        kernel = _whole_gaussian(sigma)
        for image, out in zip(grey, values, strict=True):
            cv2.merge(_brightness_and_slopes(image, kernel), out)
        return cls(values.reshape(-1, grey.shape[2], 3), len(grey), origin)

    @property
    def height(self) -> int:
        """Height of the window, h, pixels."""
        return self.values.shape[0] // self.count

    def shows(self, box: tuple[int, int, int, int]) -> bool:
        """Whether a box (left, top, right, bottom) of the frames lies within the window."""
        (left, top), width = self.origin, self.values.shape[1]
        return left <= box[0] and top <= box[1] and box[2] <= left + width and box[3] <= top + self.height

    def sample(self, image: NDArray[np.intp], pixels: Image) -> Image:
        """Interpolate the values bilinearly.

        Parameters
        ----------
        image : ndarray of int, shape (N,)
            Index of the frame.
        pixels : ndarray of float32, shape (N, 2)
            Positions in the frame; outside of the window, those on its edge are used.

        Returns
        -------
        ndarray of float32, shape (C, N)
        """
        u, v = pixels.T - np.array(self.origin, np.float32)[:, None]
        places = stacked_places(u, v, image, self.height)
        return interpolated(self.values, places, u.shape).T

    def at(self, image: NDArray[np.intp], pixels: NDArray[np.intp]) -> Image:
        """Values at whole pixels (N, 2) within the window, shape (C, N)."""
        return np.asarray(self.values.reshape(-1, self.values.shape[2]).take(self._index(image, pixels), axis=0).T)

    def brightness_at(self, image: NDArray[np.intp], pixels: NDArray[np.intp]) -> Image:
        """Brightness at whole pixels (N, 2) within the window, shape (N,)."""
        return np.asarray(self.values.reshape(-1).take(self.values.shape[2] * self._index(image, pixels)))

    def _index(self, image: NDArray[np.intp], pixels: NDArray[np.intp]) -> NDArray[np.intp]:
        u, v = pixels.T
        return np.asarray((v - self.origin[1] + image * self.height) * self.values.shape[1] + u - self.origin[0])


def stacked_places(
    u: NDArray[np.floating[Any]], v: NDArray[np.floating[Any]], image: NDArray[np.intp], height: int
) -> NDArray[np.float32]:
    """Convert positions in images to positions in their vertical stack, as `interpolated` takes them.

    Positions above or below an image are moved to its edge; `image` is broadcast to u and v.
    """
    places = np.zeros((2, (u.size // _ROW + 1) * _ROW), np.float32)  # OpenCV takes no more than 32767 rows
    places[0, : u.size] = u.ravel()
    # As OpenCV rounds them; in single precision, a place far down the stack would be rounded otherwise.
    row = np.clip(v, 0, height - 1).astype(np.float32) * np.float32(_STEPS)
    np.rint(row, out=row)
    row *= np.float32(1 / _STEPS)
    row += (image * height).astype(np.float32)
    places[1, : u.size] = row.ravel()
    return places.reshape(2, -1, _ROW)


def interpolated(image: NDArray[Any], places: Image, shape: tuple[int, ...]) -> NDArray[Any]:
    """Interpolate an image bilinearly at positions from `stacked_places`, which were made of arrays of `shape`; the
    result has one more axis for images of several channels.
    """
    values = cv2.remap(image, places[0], places[1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    channels = image.shape[2:]
    return np.asarray(values.reshape(-1, *channels)[: math.prod(shape)].reshape(*shape, *channels))
