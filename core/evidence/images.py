"""Reduced frames of a view, and the brightness and gradient images made of them when they are needed."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from ..cameras import Camera

Image = NDArray[np.float32]

MARGIN = 6
"""How far around what is looked for a frame is looked at, pixels."""


@dataclass(frozen=True, eq=False)
class GradientImage:
    """A window of a frame as the evidence needs it: brightness 0 to 1 and its derivatives per pixel, each (h, w).

    Attributes
    ----------
    origin : tuple of int
        The frame's pixel (u, v) that is the window's first.
    """

    brightness: Image
    du: Image
    dv: Image
    origin: tuple[int, int] = (0, 0)

    @classmethod
    def of(cls, grey: NDArray[np.uint8], sigma: float, origin: tuple[int, int] = (0, 0)) -> GradientImage:
        """From 8 bits, smoothed by a Gaussian of `sigma` pixels."""
        smooth = cv2.GaussianBlur(grey.astype(np.float32) * np.float32(1 / 255), (0, 0), sigma)
        du, dv = (cv2.Scharr(smooth, cv2.CV_32F, *order, scale=1 / 32) for order in ((1, 0), (0, 1)))
        return cls(smooth, du, dv, origin)

    def sample(self, pixels: Image) -> Image:
        """Brightness and derivatives at sub-pixel places (N, 2) of the frame, bilinear, shape (3, N).

        Beyond the window it is the window's edge.
        """
        places = (pixels - np.array(self.origin, np.float32))[:, None]
        out = np.empty((3, len(pixels), 1), np.float32)
        for channel, target in zip((self.brightness, self.du, self.dv), out, strict=True):
            cv2.remap(channel, places, None, cv2.INTER_LINEAR, dst=target, borderMode=cv2.BORDER_REPLICATE)
        return out[..., 0]

    def at(self, pixels: Image) -> Image:
        """Brightness and derivatives at whole pixels (N, 2) of the frame, shape (3, N)."""
        u, v = (pixels.T - np.array(self.origin, np.float32)[:, None]).astype(np.intp)
        index = v * self.brightness.shape[1] + u
        return np.stack([channel.ravel()[index] for channel in (self.brightness, self.du, self.dv)])


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
    """

    camera: Camera
    grey: NDArray[np.uint8]
    first: int

    def image(self, frame: int, sigma: float, box: tuple[int, int, int, int]) -> GradientImage:
        """The gradient image of a shot frame within a box (left, top, right, bottom) and a little around it."""
        margin = MARGIN + int(np.ceil(2 * sigma))
        left, top = max(box[0] - margin, 0), max(box[1] - margin, 0)
        window = self.grey[frame - self.first, top : box[3] + margin, left : box[2] + margin]
        return GradientImage.of(window, sigma, (left, top))
