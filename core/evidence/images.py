"""Reduced frames of a view, and the brightness and gradient images made of them when they are needed."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from ..cameras import Camera
from ..visibility import NEAR

Image = NDArray[np.float32]

MARGIN = 6
"""How far around what is looked for a frame is looked at, pixels."""
_ROW = 256


@dataclass(frozen=True, eq=False)
class GradientImages:
    """One window of n frames as the evidence needs it: brightness 0 to 1 and its derivatives per pixel.

    Attributes
    ----------
    channels : tuple of ndarray, shape (n h, w)
        Brightness and its derivatives by u and v, the windows one below the other.
    count : int
        n.
    origin : tuple of int
        The frames' pixel (u, v) that is the window's first.
    """

    channels: tuple[Image, Image, Image]
    count: int
    origin: tuple[int, int] = (0, 0)

    @classmethod
    def of(cls, grey: NDArray[np.uint8], sigma: float, origin: tuple[int, int] = (0, 0)) -> GradientImages:
        """From windows of 8 bits (n, h, w), smoothed by a Gaussian of `sigma` pixels."""
        stack = grey.reshape(-1, grey.shape[2]).astype(np.float32) * np.float32(1 / 255)
        smooth = cv2.GaussianBlur(stack, (0, 0), sigma)
        du, dv = (cv2.Scharr(smooth, cv2.CV_32F, *order, scale=1 / 32) for order in ((1, 0), (0, 1)))
        return cls((smooth, du, dv), len(grey), origin)

    @property
    def height(self) -> int:
        return self.channels[0].shape[0] // self.count

    def sample(self, image: NDArray[np.intp], pixels: Image) -> Image:
        """Brightness and derivatives at sub-pixel places, bilinear.

        Parameters
        ----------
        image : ndarray of int, shape (N,)
            Which of the n frames.
        pixels : ndarray of float32, shape (N, 2)
            Places in the frame; beyond the window, the window's edge is taken.

        Returns
        -------
        ndarray of float32, shape (3, N)
        """
        N = len(pixels)
        grid = stacked_places(pixels - np.float32(self.origin), image, self.height)
        return np.stack(
            [
                cv2.remap(channel, grid, None, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE).ravel()[:N]
                for channel in self.channels
            ]
        )

    def at(self, image: NDArray[np.intp], pixels: NDArray[np.intp]) -> Image:
        """Brightness and derivatives at whole pixels (N, 2) within the window, shape (3, N)."""
        rows = pixels[:, 1] - self.origin[1] + image * self.height
        index = rows * self.channels[0].shape[1] + pixels[:, 0] - self.origin[0]
        return np.stack([channel.ravel()[index] for channel in self.channels])


def stacked_places(pixels: NDArray[np.floating], image: NDArray[np.intp], height: int) -> Image:
    """Places (N, 2) in images that stand one below the other, as `cv2.remap` takes them; the last ones are padding.

    A place above or below its image is taken at the image's edge.
    """
    N = len(pixels)
    places = np.zeros(((N // _ROW + 1) * _ROW, 2), np.float32)  # OpenCV takes no more than 32767 rows
    places[:N, 0] = pixels[:, 0]
    places[:N, 1] = np.clip(pixels[:, 1], 0, height - 1) + image * height
    return places.reshape(-1, _ROW, 2)


@dataclass(frozen=True, eq=False)
class ViewFrames:
    """Some consecutive frames of a view, reduced and rectified.

    Attributes
    ----------
    camera : Camera
        Of the reduced frames, without distortion.
    grey : ndarray of uint8, shape (N, h, w)
    first : int
        Shot frame of the first of them.
    foreground : ndarray of uint8, shape (N, h, w), optional
        See `core.evidence.appearance`.
    """

    camera: Camera
    grey: NDArray[np.uint8]
    first: int
    foreground: NDArray[np.uint8] | None = None

    def images(self, first: int, count: int, sigma: float, box: tuple[int, int, int, int]) -> GradientImages:
        """The gradient images of consecutive shot frames within a box (left, top, right, bottom) and around it."""
        margin = MARGIN + int(np.ceil(2 * sigma))
        left, top = max(box[0] - margin, 0), max(box[1] - margin, 0)
        start = first - self.first
        window = self.grey[start : start + count, top : box[3] + margin, left : box[2] + margin]
        return GradientImages.of(window, sigma, (left, top))

    def foreground_at(self, first: int, count: int) -> NDArray[np.uint8]:
        """The foreground images of consecutive shot frames, shape (count, h, w)."""
        assert self.foreground is not None
        start = first - self.first
        return self.foreground[start : start + count]

    def pixels_per_metre(self, point_world: NDArray[np.float64], frame: int) -> float:
        """How large a metre that faces the camera is at a point."""
        R, t = self.camera.pose(frame)
        return float(self.camera.matrix[[0, 1], [0, 1]].mean() / max((R @ point_world + t)[2], NEAR))
