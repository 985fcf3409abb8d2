"""Small balls measured by a model of their image.

A ball of a few pixels has no measurable edge, and the centroid of its colour lies off its centre: towards the lit side,
away from the rod that hides a part of it, and wherever the background's texture resembles it. So its image is computed
instead, as a camera forms it, and fitted to the pixels: a background, in front of it a disc that is brighter on one
side and swept along a path while the shutter is open, in front of that the rods that lead away from the ball; blurred
by the lens in linear light, and again, after the gamma curve, by colour subsampling.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from ...capture.linear_light import GAMMA, linear_light
from ...numerics.arrays import Array, Bools

Image = NDArray[Any]

_LENS = 0.5  # standard deviation of the blur by the lens and the pixels' size, pixels
_EVEN = 1.0  # of the blur that makes brightness as soft as subsampled colour, pixels
_SUBSAMPLED = 0.3  # of what colour subsampling adds to it
_MARGIN = 5  # pixels of background around a ball
_LIMB = 3.0  # pixels beyond the outline that are compared
_CLEAR = 2.5  # pixels beyond the outline from which on there is background alone
_ROD = 3.0  # pixels to both sides of a rod that may be its own
_MOMENTS = 6  # of the exposure, at most
_MOMENT_PIXELS = 0.8  # of the path between two moments: no more than the blur bridges
_CENTRE, _RADIUS, _SHADE, _LIGHT, _PATH = slice(0, 2), 2, slice(3, 5), slice(5, 8), slice(8, 10)
_WIDTH, _ROD_LIGHT, _STARTS = 10, slice(11, 14), slice(14, 16)
_UNKNOWNS = 16
_FORM = np.r_[0:3, 8:11, 14:16]  # the unknowns that change what covers what
_STEPS = np.array([0.05, 0.05, 0.03, 0.02, 0.02, 0.05, 0.05, 0.05, 0.1, 0.1, 0.05, 0.1, 0.1, 0.1, 0.05, 0.05])
"""Steps of the finite differences, by unknown."""
_FURTHEST = np.array([0.5, 0.5, 0.2, 0.15, 0.15, 0.5, 0.5, 0.5, 0.7, 0.7, 0.2, 0.7, 0.7, 0.7, 0.2, 0.2])
"""Largest change in one iteration, by unknown."""
_BRIGHTNESS, _COLOURS = 1.7, 0.8
"""Weights of brightness and of the two differences of colour of a ball that rests: of these, video keeps one for every
four pixels, which shifts them by up to half a pixel, on all frames alike. A ball that moves lies elsewhere on each."""
_COMPARED = np.array([_BRIGHTNESS, _COLOURS, _COLOURS])[:, None] * [
    [0.114, 0.587, 0.299],
    [0.5, -0.331, -0.169],
    [-0.081, -0.419, 0.5],
]
"""Brightness and differences of colour (ITU-R BT.601) of blue, green and red."""
_PIXEL_SIGMA = 0.02  # of what the model leaves, levels from 0 to 1
_ROBUST = 3.0  # scale of the kernel, in standard deviations
_SHARED = 2.0  # blurred pixels share what they show: so many count as one
_ALIKE = 0.1  # standard deviation of how balls of one view look, about what they have in common
_ITERATIONS = 10  # at most
_SETTLED = 3e-3  # pixels
_DARKEST = 1e-4  # linear light
_PLATE_MISFIT = 0.03  # levels by which pixels around a ball may differ from the background seen without it
_PLATE_GAIN = 1.4  # factor by which the exposure may differ from that of the background's picture
_FLOOR = 0.03  # standard deviation that the best of images leaves, pixels
_ROD_SIGMA = 0.1  # what the shape of a rod where it meets the ball adds along the rod, pixels
_ROD_SHARE = 0.2  # and as a share of the path: a rod turns while the shutter is open
_PATH_SHARE = 0.03  # of the path: its speed need not be even


@dataclass(frozen=True, eq=False)
class BallLooks:
    """How a ball and its rods look in one view: the balls of an L-frame have this in common.

    Attributes
    ----------
    light : ndarray, shape (3,)
        The ball's colour, logarithms of linear light.
    shade : ndarray, shape (2,)
        How much brighter than in its middle it is at the outline, to the right and below, as a share.
    width : float
        Half the rods' width, as a share of the ball's radius.
    rod_light : ndarray, shape (3,)
        The rods' colour, logarithms of linear light; NaN where no rod is seen, and so is their width.
    """

    light: Array
    shade: Array
    width: float
    rod_light: Array

    @classmethod
    def common(cls, several: Sequence[BallLooks]) -> BallLooks:
        """What some balls have in common: the median of each number."""
        with_rods = [own for own in several if np.isfinite(own.width)] or several[:1]
        return cls(
            np.median([own.light for own in several], axis=0),
            np.median([own.shade for own in several], axis=0),
            float(np.median([own.width for own in with_rods])),
            np.median([own.rod_light for own in with_rods], axis=0),
        )


@dataclass(frozen=True, eq=False)
class BallGuess:
    """Where a ball is expected, and how it should look.

    Attributes
    ----------
    centre : ndarray, shape (2,)
        Pixels.
    radius : float
        Pixels.
    radius_sigma : float
        Its standard deviation, as a share.
    path : ndarray, shape (2,)
        How far it moves during the exposure, pixels; zero if the ball is known to rest.
    path_sigma : float
        Standard deviation of the path, as a share of its length; 0.2 pixels come in addition.
    rods : ndarray, shape (m, 2)
        Unit vectors along the rods that lead away from it, at most two.
    starts : ndarray, shape (m,)
        How far from the ball's centre each is seen to begin, as a share of the radius: a rod that comes towards the
        camera hides a part of the ball; one that leads away, from 1 on, is hidden by it.
    light : ndarray, shape (3,), optional
        Its colour in linear light, if it is known.
    looks : BallLooks, optional
        How it and its rods look, if that is known from other balls of the same view.
    """

    centre: Array
    radius: float
    radius_sigma: float = 0.03
    path: Array = field(default_factory=lambda: np.zeros(2))
    path_sigma: float = 0.3
    rods: Array = field(default_factory=lambda: np.zeros((0, 2)))
    starts: Array = field(default_factory=lambda: np.zeros(0))
    light: Array | None = None
    looks: BallLooks | None = None

    @property
    def reach(self) -> float:
        """Return the radius around the centre that the ball covers during the exposure, pixels."""
        return self.radius + float(np.linalg.norm(self.path)) / 2


@dataclass(frozen=True, eq=False)
class BallImage:
    """The image of a ball, as fitted.

    Attributes
    ----------
    centre : ndarray, shape (2,)
        Of its outline in the middle of the exposure, pixels.
    radius : float
        Pixels.
    path : ndarray, shape (2,)
        How far it moved during the exposure, pixels.
    looks : BallLooks
    sigma : float
        Standard deviation of each coordinate of the centre, pixels.
    elongation : ndarray, shape (2,)
        See `Markers.elongation`.
    explained : float
        Share of the squared difference from the background that the ball explains.
    """

    centre: Array
    radius: float
    path: Array
    looks: BallLooks
    sigma: float
    elongation: Array
    explained: float

    @property
    def light(self) -> Array:
        """Return the ball's colour in linear light, shape (3,)."""
        return np.exp(self.looks.light)


def linear(levels: Array) -> Array:
    """Return the linear light of levels from 0 to 255."""
    return np.maximum(linear_light(levels), _DARKEST)


def fit_ball(image: Image, plate: Array | None, guess: BallGuess) -> BallImage | None:
    """Fit the image of a ball.

    Parameters
    ----------
    image : ndarray, shape (h, w, 3)
        Levels from 0 to 255.
    plate : ndarray, shape (h, w, 3), optional
        The same camera's picture without the ball, levels. Where it does not fit around the ball, a plane through the
        pixels around it is the background.
    guess : BallGuess

    Returns
    -------
    BallImage or None
        None where the ball lies too near the picture's edge.
    """
    window = _Window.around(image, plate, guess)
    if window is None:
        return None
    start, sigma, free = _start(window, guess)
    inside = (np.linalg.norm(window.places - guess.centre, axis=-1) < guess.reach + _LIMB)[..., None]
    x, step = start.copy(), np.diag(_STEPS)[free]
    compared = np.eye(3) if guess.path.any() else _COMPARED.T
    for _ in range(_ITERATIONS):
        images = window.rendered(np.concatenate([x[None], x + step]), guess)
        residual = (window.observed - images[0]) @ compared
        weight = inside / (1 + (residual / (_ROBUST * _PIXEL_SIGMA)) ** 2) / _PIXEL_SIGMA**2 / _SHARED
        J = ((images[1:] - images[0]) @ compared / _STEPS[free, None, None, None]).reshape(len(step), -1)
        weighted = J * weight.reshape(-1)
        H = weighted @ J.T + np.diag(1 / sigma[free] ** 2)
        g = weighted @ residual.reshape(-1) - ((x - start) / sigma**2)[free]
        change = np.clip(np.linalg.solve(H, g), -_FURTHEST[free], _FURTHEST[free])
        x[free] += change
        x[_RADIUS], x[_WIDTH] = max(x[_RADIUS], 0.5), np.clip(x[_WIDTH], 0.05, x[_RADIUS])
        if np.abs(change[:2]).max() < _SETTLED:
            break
    left = float((weight * residual**2).sum())
    whole = float((weight * ((window.observed - window.empty(x, guess)) @ compared) ** 2).sum())
    covariance = np.linalg.inv(H)[:2, :2] + _FLOOR**2 * np.eye(2) + _PATH_SHARE**2 * np.outer(x[_PATH], x[_PATH])
    rod_sigma = np.hypot(_ROD_SIGMA, _ROD_SHARE * np.linalg.norm(x[_PATH]))
    covariance += rod_sigma**2 * guess.rods.T @ guess.rods
    (least, most), ways = np.linalg.eigh(covariance)
    return BallImage(
        x[_CENTRE],
        float(x[_RADIUS]),
        x[_PATH],
        BallLooks(
            x[_LIGHT],
            x[_SHADE],
            float(x[_WIDTH] / x[_RADIUS]) if free[_WIDTH] else np.nan,
            np.where(free[_ROD_LIGHT], x[_ROD_LIGHT], np.nan),
        ),
        float(np.sqrt((least + most) / 2)),
        (most - least) / (most + least) * ways[:, 1],
        1 - left / max(whole, 1e-12),
    )


def _start(window: _Window, guess: BallGuess) -> tuple[Array, Array, Bools]:
    """Return the initial unknowns, their standard deviations, and which of them are solved for, shape (16,) each."""
    core = np.linalg.norm(window.places - guess.centre, axis=-1) < max(0.7 * guess.radius, 1.0)
    light = np.median(linear(255 * window.observed[core]), axis=0) if guess.light is None else guess.light
    length, rods = float(np.linalg.norm(guess.path)), len(guess.rods)
    start, sigma = np.zeros(_UNKNOWNS), np.ones(_UNKNOWNS)
    start[_CENTRE], sigma[_CENTRE] = guess.centre, 2.0
    start[_RADIUS], sigma[_RADIUS] = guess.radius, guess.radius_sigma * guess.radius
    sigma[_SHADE] = 0.3
    start[_LIGHT], sigma[_LIGHT] = np.log(np.maximum(light, _DARKEST)), 1.0 if guess.light is None else 0.4
    start[_PATH], sigma[_PATH] = guess.path, 0.2 + guess.path_sigma * length
    start[_WIDTH], sigma[_WIDTH] = 0.3 * guess.radius, 0.1 * guess.radius
    start[_ROD_LIGHT] = np.log(0.05)
    start[_STARTS][:rods], sigma[_STARTS] = guess.starts, 0.25
    if guess.looks is not None:
        start[_LIGHT], sigma[_LIGHT] = guess.looks.light, _ALIKE
        start[_SHADE], sigma[_SHADE] = guess.looks.shade, _ALIKE
        if rods and np.isfinite(guess.looks.width):
            start[_WIDTH], sigma[_WIDTH] = guess.looks.width * guess.radius, _ALIKE * guess.radius
            start[_ROD_LIGHT], sigma[_ROD_LIGHT] = guess.looks.rod_light, _ALIKE
    free = np.ones(_UNKNOWNS, bool)
    free[_PATH] = length > 0
    free[_WIDTH] = free[_ROD_LIGHT] = rods > 0
    free[_STARTS] = False
    free[_STARTS][:rods] = guess.starts < 1
    return start, sigma, free


@dataclass(frozen=True, eq=False)
class _Window:
    """The pixels around a ball.

    Attributes
    ----------
    places : ndarray, shape (n, n, 2)
        Pixels.
    observed : ndarray, shape (n, n, 3)
        Levels from 0 to 1, blurred by `_EVEN`.
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
    def around(cls, image: Image, plate: Array | None, guess: BallGuess) -> _Window | None:
        half = int(np.ceil(guess.reach)) + _MARGIN
        u, v = (int(n) for n in np.round(guess.centre))
        if u < half or v < half or u + half >= image.shape[1] or v + half >= image.shape[0]:
            return None
        own = slice(v - half, v + half + 1), slice(u - half, u + half + 1)
        levels = np.asarray(image[own], float) / 255
        grid = np.indices(levels.shape[:2], float)
        places = np.stack([grid[1] + u - half, grid[0] + v - half], axis=-1)
        index = np.arange(2 * half + 1)
        blur = np.exp(-((index[:, None] - index) ** 2) / (2 * (_EVEN**2 + _SUBSAMPLED**2)))
        window = cls(
            places, cv2.GaussianBlur(levels, (0, 0), _EVEN), linear(255 * levels), blur / blur.sum(axis=1)[:, None]
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
        y = np.zeros((len(forms), _UNKNOWNS))
        y[:, _FORM] = forms
        rod, paint = np.exp(x[:, None, None, _ROD_LIGHT]), np.exp(x[:, None, None, _LIGHT])
        lean = x[:, _SHADE] / x[:, _RADIUS, None]
        count = int(np.clip(np.ceil(np.linalg.norm(x[:, _PATH], axis=1).max() / _MOMENT_PIXELS), 1, _MOMENTS))
        for moment in (np.arange(count) + 0.5) / count - 0.5:
            off = self.places - (y[:, _CENTRE] + moment * y[:, _PATH])[:, None, None]
            light = self.background[None]
            for own, start, expected in zip(guess.rods, y[:, _STARTS].T, guess.starts, strict=False):
                if expected >= 1:
                    light = light + _strip(off, y, own, 0.0 * start)[form, ..., None] * (rod - light)
            if ball:
                cover = ndtr((y[:, _RADIUS, None, None] - np.linalg.norm(off, axis=-1)) / _LENS)[form, ..., None]
                shade = np.maximum(1 + np.einsum("kvui,ki->kvu", off[form], lean), 0.05)[..., None]
                light = light + cover * (shade * paint - light)
            for own, start, expected in zip(guess.rods, y[:, _STARTS].T, guess.starts, strict=False):
                if expected < 1:
                    light = light + _strip(off, y, own, start)[form, ..., None] * (rod - light)
            yield light

    def _recorded(self, light: Array) -> Array:
        levels = np.maximum(light, _DARKEST) ** (1 / GAMMA)
        blurred = self.blur @ np.moveaxis(levels, -1, 1) @ self.blur.T
        return np.asarray(np.moveaxis(blurred, 1, -1))


def _strip(off: Array, x: Array, rod: Array, start: Array) -> Array:
    """Return the share of each place that a rod covers, shape (k, n, n); it begins `start` radii from the centre."""
    along, across = off @ rod, off @ np.array([-rod[1], rod[0]])
    width, begin = x[:, _WIDTH, None, None], (start * x[:, _RADIUS])[:, None, None]
    strip = ndtr((across + width) / _LENS) - ndtr((across - width) / _LENS)
    return np.asarray(strip * ndtr((along - begin) / _LENS))


def _background(window: _Window, plate: Array | None, guess: BallGuess) -> Array:
    """Return the background in linear light: the plate, or a plane through the pixels around the ball."""
    off = window.places - guess.centre
    clear = np.linalg.norm(off, axis=-1) > guess.reach + _CLEAR
    for rod in guess.rods:
        clear &= ~((off @ rod > 0) & (np.abs(off @ np.array([-rod[1], rod[0]])) < _ROD))
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
    return np.maximum(A @ plane, _DARKEST)
