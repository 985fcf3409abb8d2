"""Reduced frames of a view, and the brightness and gradient images made of them when they are needed."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from ..cameras.camera import Camera
from ..runtime.shared_arrays import copied_from_map, each_row
from ..shot.footage_faults.continuity import single_frames
from .foreground_images.part_colours import ColouredFrames, PartColours

Image = NDArray[np.float32]

BOX_MARGIN = 6
"""Margin around a requested box for which gradient images are computed as well, pixels."""
MAX_CACHED_BYTES = 32 << 20
"""Largest size of one view's gradient images in a cache."""
_MIN_DEPTH = 0.5  # metres before the camera: nearer points have the scale of this distance
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
class GradientImages:
    """Brightness (0 to 1) and its derivatives per pixel in a window of n frames.

    Attributes
    ----------
    values : ndarray, shape (n h, w, 3)
        Brightness and its derivatives by u and v; the windows of the frames are stacked vertically.
    count : int
        The number of frames, n.
    origin : tuple of int
        Pixel (u, v) of the frames that is the first one of the window.
    """

    values: Image
    count: int
    origin: tuple[int, int] = (0, 0)

    @classmethod
    def of(cls, grey: NDArray[np.uint8], sigma: float, origin: tuple[int, int] = (0, 0)) -> GradientImages:
        """Smooth windows of 8 bits (n, h, w) by a Gaussian of `sigma` pixels and differentiate them."""
        values = np.empty((*grey.shape, 3), np.float32)
        kernel = _whole_gaussian(sigma)
        for image, out in zip(grey, values, strict=True):
            cv2.merge(_brightness_and_slopes(image, kernel), out)
        return cls(values.reshape(-1, grey.shape[2], 3), len(grey), origin)

    @property
    def height(self) -> int:
        """Height of the window, pixels."""
        return self.values.shape[0] // self.count

    def shows(self, box: tuple[int, int, int, int]) -> bool:
        """Whether a box (left, top, right, bottom) of the frames lies within the window."""
        (left, top), width = self.origin, self.values.shape[1]
        return left <= box[0] and top <= box[1] and box[2] <= left + width and box[3] <= top + self.height

    def sample(self, image: NDArray[np.intp], pixels: Image) -> Image:
        """Interpolate brightness and derivatives bilinearly.

        Parameters
        ----------
        image : ndarray of int, shape (N,)
            Index of the frame.
        pixels : ndarray of float32, shape (N, 2)
            Positions in the frame; outside of the window, those on its edge are used.

        Returns
        -------
        ndarray of float32, shape (3, N)
        """
        u, v = pixels.T - np.array(self.origin, np.float32)[:, None]
        places = stacked_places(u, v, image, self.height)
        return interpolated(self.values, places, u.shape).T

    def at(self, image: NDArray[np.intp], pixels: NDArray[np.intp]) -> Image:
        """Brightness and derivatives at whole pixels (N, 2) within the window, shape (3, N)."""
        u, v = pixels.T
        index = (v - self.origin[1] + image * self.height) * self.values.shape[1] + u - self.origin[0]
        return np.asarray(self.values.reshape(-1, 3).take(index, axis=0).T)


@dataclass(frozen=True, eq=False)
class BrightnessImages:
    """Smoothed brightness (0 to 1) in a window of n frames.

    Attributes
    ----------
    values : ndarray, shape (n h, w)
        The windows of the frames are stacked vertically.
    height : int
        Height of the window, h, pixels.
    origin : tuple of int
        Pixel (u, v) of the frames that is the first one of the window.
    """

    values: Image
    height: int
    origin: tuple[int, int] = (0, 0)

    @classmethod
    def of(cls, grey: NDArray[np.uint8], sigma: float, origin: tuple[int, int] = (0, 0)) -> BrightnessImages:
        """Smooth windows of 8 bits (n, h, w) by a Gaussian of `sigma` pixels."""
        values = np.empty(grey.shape, np.float32)
        kernel = _whole_gaussian(sigma)
        for image, out in zip(grey, values, strict=True):
            np.multiply(_smoothed(image, kernel), np.float32(1 / _WHITE), out=out)
        return cls(values.reshape(-1, grey.shape[2]), grey.shape[1], origin)

    def sample(self, image: NDArray[np.intp], pixels: Image) -> Image:
        """Interpolate bilinearly at pixels (N, 2) of the frames with indices (N,), shape (N,)."""
        u, v = pixels.T - np.array(self.origin, np.float32)[:, None]
        return interpolated(self.values, stacked_places(u, v, image, self.height), u.shape)


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


@dataclass(frozen=True, eq=False)
class ViewFrames:
    """Consecutive frames of a view, reduced in size and without lens distortion.

    Attributes
    ----------
    camera : Camera
        The camera for the reduced frames, without lens distortion.
    grey : ndarray of uint8, shape (N, h, w)
    first : int
        Shot frame of the first of them.
    foreground : ndarray of uint8, shape (M, N, h, w), optional
        Foreground images of each of M performers, see `core.evidence.foreground_images.foreground`.
    halo : float
        Distance by which foreground images extend beyond the body's edge, pixels.
    delay : float
        How much later than the shot's frames these were taken, in frames; see `core.body.time_shift`.
    torn : ndarray of bool, shape (N - 1,), optional
        Pairs of frames that do not continue each other and are not used as evidence, see `footage_faults.continuity`.
    damaged : ndarray of bool, shape (N,), optional
        Frames that are not used as evidence, nor the pairs that they belong to.
    colours : PartColours, optional
        Colours of the performers' parts.
    palette : ndarray of uint8, shape (N, h, w), optional
        Index of the palette's colour of every pixel.
    """

    camera: Camera
    grey: NDArray[np.uint8]
    first: int
    foreground: NDArray[np.uint8] | None = None
    halo: float = 0.0
    delay: float = 0.0
    torn: NDArray[np.bool_] | None = None
    damaged: NDArray[np.bool_] | None = None
    colours: PartColours | None = None
    palette: NDArray[np.uint8] | None = None

    def sound(self, first: int, count: int) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
        """Return which of consecutive shot frames are evidence, (count,), and which of their pairs, (count - 1,)."""
        N = len(self.grey)
        torn = np.zeros(N - 1, bool) if self.torn is None else self.torn
        bad = np.zeros(N, bool) if self.damaged is None else self.damaged
        start = first - self.first
        frames, pairs = ~(single_frames(torn) | bad), ~(torn | bad[:-1] | bad[1:])
        return frames[start : start + count], pairs[start : start + count - 1]

    def part_colours(self, first: int, count: int, stride: int = 1) -> ColouredFrames | None:
        """Return the palette colours of consecutive shot frames, at every stride-th pixel; None without any."""
        if self.colours is None or self.palette is None:
            return None
        start = first - self.first
        return ColouredFrames(self.colours, copied_from_map(self.palette[start : start + count, ::stride, ::stride]))

    def foreground_at(self, first: int, count: int, stride: int = 1) -> NDArray[np.uint8]:
        """Return the foreground images of consecutive shot frames at every stride-th pixel, shape (M, count, h, w)."""
        assert self.foreground is not None
        start = first - self.first
        return copied_from_map(self.foreground[:, start : start + count, ::stride, ::stride])

    def pixels_per_metre(self, point_world: NDArray[np.float64], frame: int) -> float:
        """Length in pixels of a metre that faces the camera at a point (3,); points behind it count as in front of
        it.
        """
        R, t = self.camera.pose(frame)
        return float(self.camera.matrix[[0, 1], [0, 1]].mean() / max((R @ point_world + t)[2], _MIN_DEPTH))


class GradientImageCache:
    """Gradient images, kept from one evaluation of the evidence to the next, when performers have hardly moved.

    Threads may share a cache; what it returns does not depend on their order.
    """

    def __init__(self) -> None:
        self._kept: dict[ViewFrames, dict[tuple[int, int], tuple[float, GradientImages]]] = {}

    def images(self, view: ViewFrames, frames: range, sigma: float, box: tuple[int, int, int, int]) -> GradientImages:
        """Return the gradient images of consecutive shot frames in a box (left, top, right, bottom) and around it."""
        margin, (height, width) = BOX_MARGIN + int(np.ceil(2 * sigma)), view.grey.shape[1:]
        left, top = max(box[0] - margin, 0), max(box[1] - margin, 0)
        right, bottom = min(box[2] + margin, width), min(box[3] + margin, height)
        kept = self._kept.setdefault(view, {})
        kept_sigma, images = kept.get((frames.start, len(frames)), (0.0, None))
        if images is not None and kept_sigma == sigma and images.shows((left, top, right, bottom)):
            return images
        left, top = max(left - BOX_MARGIN, 0), max(top - BOX_MARGIN, 0)  # a little more, for the next time
        start = frames.start - view.first
        window = copied_from_map(
            view.grey[start : start + len(frames), top : bottom + BOX_MARGIN, left : right + BOX_MARGIN]
        )
        images = GradientImages.of(window, sigma, (left, top))
        for first, count in list(kept):  # those that show some of the same pairs of frames are replaced
            if min(first + count, frames.stop) - max(first, frames.start) > 1:
                kept.pop((first, count), None)  # another thread may have done it
        # The same are kept whichever thread comes first: what lies beyond a window's edge depends on it.
        windows = 1 + start / max(images.count - 1, 1)
        if windows * images.values.nbytes <= MAX_CACHED_BYTES:
            kept[frames.start, len(frames)] = sigma, images
        return images


def views_with_foreground(views: Sequence[ViewFrames]) -> list[ViewFrames]:
    """Return the views with foreground images."""
    return [view for view in views if view.foreground is not None]
