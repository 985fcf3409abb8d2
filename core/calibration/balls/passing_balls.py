"""Small moving balls in front of a known background, found by a matched filter.

A small ball that moves while the shutter is open shares every pixel with the background, and in dim light the noise of
a pixel is as large as what the ball adds to it. But a camera that stands still shows its background on the other
frames, and the colour of a ball that was seen clearly once is known. So the difference of a frame from the background,
in standard deviations of the footage's own noise, is compared with the difference that such a ball would make, over the
area of a ball. Differences of another colour, as an arm, a rod or a shadow makes them, count against it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from ...capture.linear_light import GAMMA, LINEAR_LIGHT
from ...numerics.arrays import Array
from ...numerics.robust_kernels import NORMAL_MAD
from .found_balls import Balls, FoundBall

Image = NDArray[Any]

_SHARE = 0.35  # of a ball in a pixel of its path: which way that pixel goes from the background
_FILTER_SIGMA = 1.6  # deviation of the filter, pixels
_PEAK_WINDOW = np.ones((5, 5), np.uint8)  # where a peak is the highest
_HALF_WINDOW = 26  # of a window around a peak, pixels
_EDGE_WIDTH = 3  # pixels from the picture's edge within which a part of a ball may be missing
_MIN_SAMPLES = 4  # samples of a ball's colour
_OTHERS = 2  # peaks of a frame that may be balls of the wand: the next one is noise, or something else
_MIN_PEAK_RATIO = 1.4  # of a ball's peak to the peaks that follow
_MAX_SAMPLE_SHARE = 0.1  # but no more than this share of the peaks of the samples
_MIN_PEAK_SIGMAS = 6.0  # of the noise's deviations that a peak is high
_MAX_PEAKS = 6  # peaks that are measured on a frame
_CORE_SHARE = 0.4  # of the highest share of a ball
_RIM_SIDE = 5  # side of what blur adds around the core, pixels
_SURROUNDINGS_SIDE = 5  # side of what lies around that
_MAX_SHARE_AROUND = 0.4  # share of a ball's colour that may lie around it
_MIN_RADIUS, _MAX_RADIUS = 0.8, 8.0  # of a ball, pixels
_MAX_ELONGATION = 7.0  # length over width of a trace
_BLUR_SIGMA = 1.3  # deviation of lens, sensor and smoothing together, pixels
_MAX_BREADTH = 2.5  # how many times as broad as a ball's own a trace may be, squared
_MIN_SIGMA, _PATH_SHARE = 0.15, 0.12  # deviation of a centroid, pixels, and as a share of half the path
_SHADING_SHARE = 0.18  # of the radius: what light from one side, a rod or a hand shift the centroid
_EXPOSURE_STRIDE = 8  # between the pixels by which a frame's exposure is estimated
_NOISE_STRIDE = 4  # between the pixels by which a frame's noise is estimated
_MIN_LIT_LEVEL, _MAX_LIT_LEVEL, _MIN_LIT_PIXELS = 0.05, 0.98, 50  # levels of these pixels, and how many are needed
_MIN_NOISE = 0.5 / 255  # levels from 0 to 1
_MIN_LIGHT = 0.02  # levels from 0 to 1


@dataclass(frozen=True, eq=False)
class BallSample:
    """A ball that was seen clearly.

    Attributes
    ----------
    even : ndarray of uint8, shape (h, w, 3)
        The frame, see `Picture.even`.
    centre : ndarray, shape (2,)
        Pixels.
    radius : float
        Pixels.
    """

    even: Image
    centre: Array
    radius: float

    @property
    def pixel(self) -> tuple[int, int]:
        """Row and column of the pixel nearest to its centre, which may lie outside where the picture's edge cuts it."""
        u, v = np.round(self.centre).astype(int)
        height, width = self.even.shape[:2]
        return min(max(int(v), 0), height - 1), min(max(int(u), 0), width - 1)


@dataclass(frozen=True, eq=False)
class Backdrop:
    """What a camera that stands still shows behind all that moves.

    Attributes
    ----------
    levels : ndarray of float32, shape (h, w, 3)
        From 0 to 1, as even as `Picture.even`.
    noise : ndarray of float32, shape (3,)
        Standard deviation of a frame's difference from it, by colour.
    """

    levels: Image
    noise: Image

    @classmethod
    def of(cls, evened: Sequence[Image], background: Image) -> Backdrop:
        """Return the backdrop of some frames as `Picture.even` and of their median, all uint8, shape (h, w, 3)."""
        found = cls(background.astype(np.float32) / 255, np.ones(3, np.float32))
        apart = [np.median(np.abs(found.frame(even).added), axis=(0, 1)) for even in evened]
        noise = np.maximum(NORMAL_MAD * np.median(apart, axis=0), _MIN_NOISE)
        return replace(found, noise=noise.astype(np.float32))

    def passes(self, ball: BallSample) -> bool:
        """Return whether a ball differs from the background, so that it is not a part of it."""
        at = ball.pixel
        return bool(np.abs(ball.even[at] / 255 - self.levels[at]).max() > _MIN_PEAK_SIGMAS * self.noise.max())

    def unmixed(self, ball: BallSample) -> Array:
        """Return the colour of a ball whose pixels blur mixes with the background's, linear light, shape (3,)."""
        at = ball.pixel
        own, behind = LINEAR_LIGHT[ball.even[at]], self.levels[at] ** GAMMA
        share = 1 - np.exp(-(ball.radius**2) / (2 * _BLUR_SIGMA**2))
        return np.asarray(np.maximum(behind + (own - behind) / share, 0.0))

    def frame(self, even: Image) -> PassingFrame:
        """Return a frame as `Picture.even`, uint8, shape (h, w, 3), compared with the background."""
        gain = self._gain(even)
        # By rows of pixels: NumPy takes ten times as long for three numbers at a time.
        height, width = even.shape[:2]
        added = even.reshape(height, -1).astype(np.float32)
        added /= 255
        added -= np.tile(gain, width) * self.levels.reshape(height, -1)
        added /= np.tile(self.noise, width)
        return PassingFrame(even, gain, added.reshape(even.shape))

    def _gain(self, even: Image) -> Image:
        own = even[::_EXPOSURE_STRIDE, ::_EXPOSURE_STRIDE].reshape(-1, 3) / np.float32(255)
        behind = self.levels[::_EXPOSURE_STRIDE, ::_EXPOSURE_STRIDE].reshape(-1, 3)
        lit = (behind > _MIN_LIT_LEVEL).all(axis=1) & (own < _MAX_LIT_LEVEL).all(axis=1)
        if lit.sum() < _MIN_LIT_PIXELS:
            return np.ones(3, np.float32)
        return np.asarray(np.median(own[lit] / behind[lit], axis=0))


@dataclass(frozen=True, eq=False)
class PassingFrame:
    """A frame and its difference from the background.

    Attributes
    ----------
    even : ndarray of uint8, shape (h, w, 3)
        See `Picture.even`.
    gain : ndarray of float32, shape (3,)
        Factor by which it is lighter as a whole, by colour: a camera may change its exposure.
    added : ndarray of float32, shape (h, w, 3)
        Its difference from the background, in standard deviations of the noise.
    """

    even: Image
    gain: Image
    added: Image

    @cached_property
    def smooth(self) -> Image:
        """Return the difference from the background, smoothed over the area of a ball."""
        return np.asarray(cv2.GaussianBlur(self.added, (0, 0), _FILTER_SIGMA))


@dataclass(frozen=True, eq=False)
class PassingBalls:
    """A matched filter for balls of one colour.

    Attributes
    ----------
    backdrop : Backdrop
    light : ndarray, shape (3,)
        The ball's colour in linear light.
    way, aside : ndarray of float32, shape (h, w, 3)
        Unit vectors in the colours, scaled by the noise: the direction in which a ball changes each pixel of the
        background, apart from making it lighter or darker, as rods and shadows do, too; and the direction perpendicular
        to both.
    threshold : float
        The least peak, in standard deviations of the filter's own noise.
    size : float
        Ratio of the balls' size to the size that the amount of their colour suggests.
    """

    backdrop: Backdrop
    light: Array
    way: Image
    aside: Image
    threshold: float = _MIN_PEAK_SIGMAS
    size: float = 1.0

    @classmethod
    def learned(cls, backdrop: Backdrop, samples: Sequence[BallSample]) -> PassingBalls | None:
        """Return a filter for balls that were seen clearly on some frames; None where they are too few, or not small.

        Its threshold lies above what else those frames show, and below the balls' own peaks.
        """
        if len(samples) < _MIN_SAMPLES or np.median([ball.radius for ball in samples]) > _MAX_RADIUS:
            return None
        lights = np.array([backdrop.unmixed(ball) for ball in samples])
        light = np.exp(np.median(np.log(np.maximum(lights, _MIN_LIGHT**GAMMA)), axis=0))
        behind = np.maximum(backdrop.levels, _MIN_LIGHT) ** GAMMA
        mixed = (behind + _SHARE * (light.astype(np.float32) - behind)) ** (1 / GAMMA)
        shade = _unit(backdrop.levels / backdrop.noise)
        way = _unit(_beside((mixed - backdrop.levels) / backdrop.noise, shade))
        found = cls(backdrop, light, way.astype(np.float32), np.cross(shade, way).astype(np.float32))
        own: list[float] = []
        sizes: list[float] = []
        others = [0.0]
        for even in {id(ball.even): ball.even for ball in samples}.values():
            frame = backdrop.frame(even)
            heights, places = found._peaks(frame, 0.0)
            others.extend(heights[_OTHERS : _OTHERS + 1].tolist())
            for ball in samples:
                near = np.linalg.norm(places[:, ::-1] - ball.centre, axis=1) < ball.radius + _FILTER_SIGMA
                if ball.even is even and near.any():
                    own.append(float(heights[near][0]))
                    if (again := found._measured(frame, places[near][0])) is not None:
                        sizes.append(ball.radius / float(np.linalg.norm(again.shape, -2)))
        above = _MIN_PEAK_RATIO * float(np.median(others))
        threshold = max(_MIN_PEAK_SIGMAS, min(above, _MAX_SAMPLE_SHARE * float(np.median(own or [np.inf]))))
        return replace(found, threshold=threshold, size=float(np.median(sizes or [1.0])))

    def find(self, frame: PassingFrame) -> Balls:
        """Return the small moving balls of a frame, the most certain first."""
        places = self._peaks(frame, self.threshold)[1]
        found: list[FoundBall] = []
        for place in places[:_MAX_PEAKS]:
            measured = self._measured(frame, place)
            if measured is not None and all(
                np.linalg.norm(measured.centre - other.centre) > np.linalg.norm(other.shape, 2) for other in found
            ):
                found.append(measured)
        return Balls.of(found)

    def _peaks(self, frame: PassingFrame, least: float) -> tuple[Array, NDArray[np.int64]]:
        """Return the heights of the filter's peaks, decreasing, in deviations of its noise, and their pixels (v, u)."""
        along, across = _dot(frame.smooth, self.way), _dot(frame.smooth, self.aside)
        some = along[::_NOISE_STRIDE, ::_NOISE_STRIDE]
        noise = max(NORMAL_MAD * float(np.median(np.abs(some))), 1e-6)
        score = (along - np.abs(across)) / noise
        highest = (score >= cv2.dilate(score, _PEAK_WINDOW)) & (score > least)
        places = np.argwhere(highest)
        heights = score[highest]
        order = np.argsort(-heights)
        return heights[order], places[order]

    def _measured(self, frame: PassingFrame, place: NDArray[np.int64]) -> FoundBall | None:
        """Return the ball at a peak; None if there is none."""
        size = np.array(frame.even.shape[:2])
        if (place < _EDGE_WIDTH).any() or (place >= size - _EDGE_WIDTH).any():
            return None
        (top, left), (bottom, right) = np.maximum(place - _HALF_WINDOW, 0), np.minimum(place + _HALF_WINDOW + 1, size)
        own = slice(top, bottom), slice(left, right)
        share, noise = self._share(frame, own)
        v, u = place - [top, left]
        core = _joined(cv2.blur(share, (3, 3)), v, u, noise)
        if core[[0, -1]].any() or core[:, [0, -1]].any():
            return None  # a part of something larger
        near = cv2.dilate(core.astype(np.uint8), np.ones((_RIM_SIDE, _RIM_SIDE), np.uint8)) > 0
        around = (
            cv2.dilate(near.astype(np.uint8), np.ones((_SURROUNDINGS_SIDE, _SURROUNDINGS_SIDE), np.uint8)) > 0
        ) & ~near
        total = float(share[near].sum())
        if total < np.pi * _MIN_RADIUS**2 or float(share[around].sum()) > _MAX_SHARE_AROUND * total:
            return None
        places = np.argwhere(near)[:, ::-1].astype(float)
        weights = share[near] / total
        centre = weights @ places
        off = places - centre
        values, vectors = np.linalg.eigh(np.einsum("n,ni,nj->ij", weights, off, off))
        radius = float(np.sqrt(total / np.pi))
        path = float(np.sqrt(12 * max(values[1] - max(values[0], 0.0), 0.0)))
        broad = values[0] > _MAX_BREADTH * (radius**2 / 4 + _BLUR_SIGMA**2)
        if broad or radius >= _MAX_RADIUS or radius + path / 2 > _MAX_ELONGATION * radius:
            return None
        shape = (vectors * [self.size * radius, self.size * radius + path / 2]) @ vectors.T
        scatter = noise * float(np.sqrt((off**2).sum() / 2)) / total
        sigma = float(
            np.sqrt(_MIN_SIGMA**2 + scatter**2 + (_PATH_SHARE * path / 2) ** 2 + (_SHADING_SHARE * radius) ** 2)
        )
        return FoundBall(centre + [left, top], shape, sigma)

    def _share(self, frame: PassingFrame, own: tuple[slice, slice]) -> tuple[Array, float]:
        """Return how much of every pixel of a window is the ball's colour, and its standard deviation."""
        levels = np.maximum((frame.gain * self.backdrop.levels[own]).astype(float), _MIN_LIGHT)
        behind = levels**GAMMA
        added = np.maximum(frame.even[own].astype(float) / 255, _MIN_LIGHT) ** GAMMA - behind
        noise = GAMMA * levels ** (GAMMA - 1) * self.backdrop.noise
        toward = _beside((self.light - behind) / noise, _unit(behind / noise))
        information = np.maximum(np.sum(toward**2, axis=2), 1e-12)
        return np.sum(toward * added / noise, axis=2) / information, float(1 / np.sqrt(np.median(information)))


def _dot(a: Image, b: Image) -> Image:
    """Return the products of two pictures' colours, added up, shape (h, w)."""
    return np.asarray(cv2.transform(cv2.multiply(a, b), np.ones((1, 3), np.float32)))


def _unit(vectors: Array) -> Array:
    return vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-6)


def _beside(vectors: Array, ways: Array) -> Array:
    """Return the components of vectors that are perpendicular to unit vectors."""
    return vectors - np.sum(vectors * ways, axis=-1, keepdims=True) * ways


def _joined(share: Array, v: int, u: int, noise: float) -> NDArray[np.bool_]:
    """Return the pixels around a peak that have much of what it has."""
    least = max(_CORE_SHARE * float(share[max(v - 1, 0) : v + 2, max(u - 1, 0) : u + 2].max()), 2 * noise)
    above = (share > least).astype(np.uint8)
    above[v, u] = 1
    _, labels = cv2.connectedComponents(above, connectivity=8)
    return np.asarray(labels == labels[v, u])
