"""The image of a ball as a camera forms it, from the unknowns by which it is fitted.

A background, in front of it a disc that is brighter on one side and swept along a path while the shutter is open, in
front of that the rods that lead away from the ball; blurred by the lens in linear light, and again, after the gamma
curve, by colour subsampling.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from ...capture.linear_light import GAMMA, linear_light
from ...numerics.arrays import Array
from .ball_appearance import BallGuess

Image = NDArray[Any]

CENTRE, RADIUS, SHADE, LIGHT, PATH = slice(0, 2), 2, slice(3, 5), slice(5, 8), slice(8, 10)
WIDTH, ROD_LIGHT, STARTS = 10, slice(11, 14), slice(14, 16)
"""Indices of the unknowns: those of the ball, then those of its rods. The light is a logarithm."""
UNKNOWNS = 16
MIN_LIGHT = 1e-4
"""Least linear light."""
_FORM = np.r_[0:3, 8:11, 14:16]
"""The unknowns that change what covers what."""
_LENS_SIGMA = 0.5  # standard deviation of the blur by the lens and the pixels' size, pixels
_CHROMA_SIGMA = 1.0  # of the blur that makes brightness as soft as subsampled colour, pixels
_SUBSAMPLED = 0.3  # of what colour subsampling adds to it
_MARGIN = 5  # pixels of background around a ball
_BALL_REACH = 2.5  # pixels beyond the outline from which on there is background alone
_ROD_REACH = 3.0  # pixels to both sides of a rod that may be its own
_MAX_MOMENTS = 6  # of the exposure, at most
_MAX_MOMENT_SPACING = 0.8  # of the path between two moments: no more than the blur bridges
_PLATE_MISFIT = 0.03  # levels, 0 to 1, by which pixels around a ball may differ from the background seen without it
_PLATE_GAIN = 1.4  # factor by which the exposure may differ from that of the background's picture


def linear(levels: Array) -> Array:
    """Return the linear light, 0 to 1, of levels from 0 to 255, same shape."""
    return np.maximum(linear_light(levels), MIN_LIGHT)


@dataclass(frozen=True, eq=False)
class BallWindow:
    """The pixels around a ball.

    Attributes
    ----------
    places : ndarray, shape (n, n, 2)
        Pixels.
    observed : ndarray, shape (n, n, 3)
        Levels from 0 to 1, blurred by `_CHROMA_SIGMA`.
    background : ndarray, shape (n, n, 3)
        Linear light.
    blur : ndarray, shape (n, n)
        A row or column times this matrix is blurred.
    """

    places: Array
    observed: Array
    background: Array
    blur: Array

    @classmethod
    def around(cls, image: Image, plate: Array | None, guess: BallGuess) -> BallWindow | None:
        """Cut the pixels around a ball out of an image; None where it lies too near the picture's edge."""
        half = int(np.ceil(guess.reach)) + _MARGIN
        u, v = (int(n) for n in np.round(guess.centre))
        if u < half or v < half or u + half >= image.shape[1] or v + half >= image.shape[0]:
            return None
        own = slice(v - half, v + half + 1), slice(u - half, u + half + 1)
        levels = np.asarray(image[own], float) / 255
        grid = np.indices(levels.shape[:2], float)
        places = np.stack([grid[1] + u - half, grid[0] + v - half], axis=-1)
        index = np.arange(2 * half + 1)
        blur = np.exp(-((index[:, None] - index) ** 2) / (2 * (_CHROMA_SIGMA**2 + _SUBSAMPLED**2)))
        window = cls(
            places,
            cv2.GaussianBlur(levels, (0, 0), _CHROMA_SIGMA),
            linear(255 * levels),
            blur / blur.sum(axis=1)[:, None],
        )
        return replace(window, background=_background(window, None if plate is None else plate[own], guess))

    def rendered(self, x: Array, guess: BallGuess) -> Array:
        """Return the images for unknowns x of shape (k, 16), levels from 0 to 1, shape (k, n, n, 3)."""
        return self._recorded(np.mean(list(self._moments(x, guess, ball=True)), axis=0))

    def empty(self, x: Array, guess: BallGuess) -> Array:
        """Return the image without the ball, levels from 0 to 1, shape (n, n, 3)."""
        return np.asarray(self._recorded(np.mean(list(self._moments(x[None], guess, ball=False)), axis=0))[0])

    def _moments(self, x: Array, guess: BallGuess, *, ball: bool) -> Iterator[Array]:
        """Yield the linear light at moments spread evenly over the exposure, shape (k, n, n, 3) each."""
        # Most unknowns change colours alone: what covers what is the same for all of these.
        forms, form = np.unique(x[:, _FORM], axis=0, return_inverse=True)
        form = form.reshape(-1)
        y = np.zeros((len(forms), UNKNOWNS))
        y[:, _FORM] = forms
        rod, paint = np.exp(x[:, None, None, ROD_LIGHT]), np.exp(x[:, None, None, LIGHT])
        lean = x[:, SHADE] / x[:, RADIUS, None]
        count = int(np.clip(np.ceil(np.linalg.norm(x[:, PATH], axis=1).max() / _MAX_MOMENT_SPACING), 1, _MAX_MOMENTS))
        for moment in (np.arange(count) + 0.5) / count - 0.5:
            off = self.places - (y[:, CENTRE] + moment * y[:, PATH])[:, None, None]
            light = self.background[None]
            for own, start, expected in zip(guess.rods, y[:, STARTS].T, guess.starts, strict=False):
                if expected >= 1:
                    light = light + _strip(off, y, own, 0.0 * start)[form, ..., None] * (rod - light)
            if ball:
                cover = ndtr((y[:, RADIUS, None, None] - np.linalg.norm(off, axis=-1)) / _LENS_SIGMA)[form, ..., None]
                shade = np.maximum(1 + np.einsum("kvui,ki->kvu", off[form], lean), 0.05)[..., None]
                light = light + cover * (shade * paint - light)
            for own, start, expected in zip(guess.rods, y[:, STARTS].T, guess.starts, strict=False):
                if expected < 1:
                    light = light + _strip(off, y, own, start)[form, ..., None] * (rod - light)
            yield light

    def _recorded(self, light: Array) -> Array:
        levels = np.maximum(light, MIN_LIGHT) ** (1 / GAMMA)
        blurred = self.blur @ np.moveaxis(levels, -1, 1) @ self.blur.T
        return np.asarray(np.moveaxis(blurred, 1, -1))


def _strip(off: Array, x: Array, rod: Array, start: Array) -> Array:
    """Return the share of each place that a rod covers, shape (k, n, n); it begins `start` radii from the centre."""
    along, across = off @ rod, off @ np.array([-rod[1], rod[0]])
    width, begin = x[:, WIDTH, None, None], (start * x[:, RADIUS])[:, None, None]
    strip = ndtr((across + width) / _LENS_SIGMA) - ndtr((across - width) / _LENS_SIGMA)
    return np.asarray(strip * ndtr((along - begin) / _LENS_SIGMA))


def _background(window: BallWindow, plate: Array | None, guess: BallGuess) -> Array:
    """Return the background in linear light: the plate, or a plane through the pixels around the ball."""
    off = window.places - guess.centre
    clear = np.linalg.norm(off, axis=-1) > guess.reach + _BALL_REACH
    for rod in guess.rods:
        clear &= ~((off @ rod > 0) & (np.abs(off @ np.array([-rod[1], rod[0]])) < _ROD_REACH))
    light = window.background
    if plate is not None:
        behind = linear(plate)
        gain = np.median(light[clear] / behind[clear], axis=0)
        if (np.abs(np.log(gain)) < np.log(_PLATE_GAIN)).all():
            behind = behind * gain
            apart = np.abs(light[clear] ** (1 / GAMMA) - behind[clear] ** (1 / GAMMA))
            if float(np.median(apart)) < _PLATE_MISFIT:
                return behind
    A = np.concatenate([np.ones((*off.shape[:2], 1)), off], axis=-1)
    weight = clear.astype(float)
    for _ in range(3):
        plane = np.linalg.lstsq(A[clear] * weight[clear, None], light[clear] * weight[clear, None], rcond=None)[0]
        miss = np.abs(light - A @ plane).max(axis=-1)
        weight = clear / (1 + (miss / (3 * np.median(miss[clear]) + 1e-6)) ** 2)
    return np.maximum(A @ plane, MIN_LIGHT)
