"""Coloured balls in one picture, to a fraction of a pixel.

A colour filter finds blobs; rays from a blob's middle then cross its edge, where ball and background mix in linear
light. The place of the edge on every ray follows from how much of each is there, however the ball is shaded, and an
ellipse through these places is the ball's outline. What is no ellipse is no ball.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from .colours import Colour

Array = NDArray[np.float64]
Image = NDArray[Any]

_GAMMA = 2.2
_PEDESTAL = 0.02  # keeps a black background's colour from being no direction at all
_SPECKS = cv2.getStructuringElement(cv2.MORPH_CROSS, (3, 3))
_RAYS = 40
_STEP = 0.5
_REACHES = (2.5, 1.5)  # how far to both sides of the outline a ray goes at least: first a search, then near the limb
_LEAST_AREA = 12
_LARGEST_SHARE = 0.4  # of the picture's height
_LONGEST = 3.0  # a blur of twice the diameter
_LEAST_SOLIDITY = 0.6
_MOST_BLOBS = 60
_LEAST_CONTRAST = 0.02  # squared sine of the angle between the colours of ball and background
_SHARED = 3.0
_HOLD = np.cos(np.radians(42))
_FLOOR = 0.07
_BLUR_SHARE = 0.25


@dataclass(frozen=True)
class _Tolerance:
    """What still is a ball: share of its outline that is seen, and deviation of that, pixels and share of its radius."""

    coverage: float
    noise: float
    roundness: float


_SEARCHED = _Tolerance(0.4, 0.45, 0.1)
_MEASURED = _Tolerance(0.4, 0.3, 0.06)


@dataclass(frozen=True, eq=False)
class Balls:
    """Balls that were found in a picture.

    Attributes
    ----------
    centres : ndarray, shape (n, 2)
        Of their outlines' ellipses, pixels.
    shapes : ndarray, shape (n, 2, 2)
        Symmetric; an outline is centre + shape @ (cos, sin), pixels. A ball that moved while the shutter was open is
        longer than wide.
    sigma : ndarray, shape (n,)
        Standard deviation of each coordinate of the centre, pixels.
    """

    centres: Array
    shapes: Array
    sigma: Array

    def __len__(self) -> int:
        return len(self.centres)

    def __getitem__(self, which: NDArray | slice | list[int]) -> Balls:
        return Balls(self.centres[which], self.shapes[which], self.sigma[which])

    @property
    def semi_axes(self) -> Array:
        """Major and minor, shape (n, 2), pixels."""
        return np.linalg.eigvalsh(self.shapes)[:, ::-1]

    @classmethod
    def joined(cls, balls: Sequence[Balls]) -> Balls:
        """Several sets of balls as one."""
        if not balls:
            return cls(np.empty((0, 2)), np.empty((0, 2, 2)), np.empty(0))
        return cls(*(np.concatenate([getattr(b, item.name) for b in balls]) for item in fields(cls)))


def find_balls(image: Image, hsv: Image, colour: Colour) -> Balls:
    """All balls of a colour in a picture, the largest first.

    Parameters
    ----------
    image : ndarray of uint8, shape (h, w, 3)
        Blue, green, red.
    hsv : ndarray of uint8, shape (h, w, 3)
        The same by `to_hsv`.
    colour : Colour
    """
    mask = cv2.morphologyEx(colour.mask(hsv), cv2.MORPH_OPEN, _SPECKS)
    outlines, _ = cv2.findContours(mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    found = []
    for blob in sorted(filter(_is_compact, outlines), key=len, reverse=True)[:_MOST_BLOBS]:
        ellipse = _ellipse_of(cv2.convexHull(blob))
        if 2 * ellipse.semi_axes[0] < _LARGEST_SHARE * image.shape[0]:
            found.append(_refined(image, ellipse, None, _SEARCHED))
    return Balls.joined([ball for ball in found if len(ball)])


def without_rods(image: Image, ball: Balls, ends: Array) -> Balls:
    """One ball measured again without the parts of its outline that rods hide.

    Parameters
    ----------
    ball : Balls
        One.
    ends : ndarray, shape (n, 2)
        Where the rods lead to from its middle, pixels.

    Returns
    -------
    Balls
        One, or none where it is no ball after all.
    """
    ways = ends - ball.centres
    ways = ways / np.maximum(np.linalg.norm(ways, axis=1, keepdims=True), 1e-9)
    return _refined(image, _Ellipse(ball.centres[0], ball.shapes[0]), ways, _MEASURED)


def _is_compact(outline: Image) -> bool:
    if len(outline) < 6:
        return False
    hull = cv2.contourArea(cv2.convexHull(outline))
    # A contour goes through the outermost pixels' centres: the area of n of them is half a pixel less all round.
    edge = len(outline) / 2
    return cv2.contourArea(outline) + edge >= max(_LEAST_AREA, _LEAST_SOLIDITY * (hull + edge))


@dataclass(frozen=True, eq=False)
class _Ellipse:
    """The ellipse centre + shape @ (cos, sin); shape is symmetric, (2, 2)."""

    centre: Array
    shape: Array

    @property
    def semi_axes(self) -> Array:
        """Major and minor."""
        return np.linalg.eigvalsh(self.shape)[::-1]


def _ellipse_of(outline: Image) -> _Ellipse:
    """The ellipse with the moments of what a contour encloses."""
    m = cv2.moments(outline)
    area = max(m["m00"], 1e-9)
    covariance = np.array([[m["mu20"], m["mu11"]], [m["mu11"], m["mu02"]]]) / area
    values, vectors = np.linalg.eigh(covariance)
    half = 2 * np.sqrt(np.maximum(values, 0)) + 0.5
    return _Ellipse(np.array([m["m10"], m["m01"]]) / area, (vectors * half) @ vectors.T)


def _refined(image: Image, ellipse: _Ellipse, rods: Array | None, tolerance: _Tolerance) -> Balls:
    """The ball whose outline is near an ellipse, if there is one; `rods` are directions (n, 2) in which it is held."""
    for nearest in _REACHES:
        fit = _outline_fit(image, ellipse, rods, nearest)
        if fit is None or not _is_ellipse(fit.ellipse):
            return Balls.joined([])
        ellipse = fit.ellipse
    major, minor = ellipse.semi_axes
    if fit.coverage < tolerance.coverage or fit.residual > tolerance.noise + tolerance.roundness * minor:
        return Balls.joined([])
    sigma = np.sqrt(fit.sigma**2 + _FLOOR**2 + (_BLUR_SHARE * (major - minor)) ** 2)
    return Balls(ellipse.centre[None], ellipse.shape[None], np.array([sigma]))


def _is_ellipse(ellipse: _Ellipse) -> bool:
    major, minor = ellipse.semi_axes
    return bool(np.isfinite(major) and minor > 1 and major < _LONGEST * minor)


@dataclass(frozen=True, eq=False)
class _Fit:
    """An outline fitted to the edges on rays.

    Attributes
    ----------
    coverage : float
        Share of the rays that agree with it.
    residual : float
        Of these, root mean square, pixels.
    sigma : float
        Standard deviation of each coordinate of the centre, pixels.
    """

    ellipse: _Ellipse
    coverage: float
    residual: float
    sigma: float


def _outline_fit(image: Image, ellipse: _Ellipse, rods: Array | None, nearest: float) -> _Fit | None:
    """The outline through the edges near an ellipse, but for where rods hide them.

    In the coordinates in which that ellipse is the unit circle, the outline's distance from the middle is fitted by
    1 + r + x cos + y sin + e cos 2 + f sin 2: a shift, and to the first order another ellipse.
    """
    angles = 2 * np.pi * np.arange(_RAYS) / _RAYS
    circle = np.column_stack([np.cos(angles), np.sin(angles)])
    spokes = circle @ ellipse.shape
    lengths = np.linalg.norm(spokes, axis=1)
    major, minor = ellipse.semi_axes
    reach = min(max(nearest, 0.15 * minor) + 1.2 * (major - minor), major)
    steps = np.arange(-reach, reach + _STEP / 2, _STEP)
    places = ellipse.centre + ((lengths[:, None] + steps) / lengths[:, None])[..., None] * spokes[:, None]
    light = _light(image, places)
    if light is None:
        return None
    inside, usable = _inside_share(light, circle, np.clip(1 - reach / lengths, 0.1, 1))
    edges = steps[0] - _STEP / 2 + _STEP * inside.sum(axis=1)
    usable &= np.abs(edges) < 0.8 * reach
    if rods is not None:
        usable &= ((spokes / lengths[:, None]) @ rods.T < _HOLD).all(axis=1)
    if usable.mean() < _SEARCHED.coverage:
        return None
    basis = np.column_stack([np.ones(_RAYS), circle, np.cos(2 * angles), np.sin(2 * angles)])
    x, weights, residual = _robust_fit(basis * lengths[:, None], edges, usable)
    r, e, f = x[0], x[3], x[4]
    shape = ellipse.shape @ np.array([[1 + r + e, f], [f, 1 + r - e]])
    centre_share = np.linalg.inv((basis * weights[:, None]).T @ basis)[1:3, 1:3]
    agreeing = weights > 0.2
    scale = float(np.sqrt(np.mean(residual[agreeing] ** 2))) if agreeing.any() else np.inf
    return _Fit(
        _Ellipse(ellipse.centre + ellipse.shape @ x[1:3], (shape + shape.T) / 2),
        float(agreeing.mean()),
        scale,
        # Neighbouring rays share pixels: some three count as one.
        scale * float(np.sqrt(_SHARED * np.trace(centre_share) / 2)),
    )


def _robust_fit(A: Array, b: Array, usable: NDArray[np.bool_]) -> tuple[Array, Array, Array]:
    """Least squares with Tukey's weights: solution, weights and residuals."""
    weights = usable.astype(float)
    for _ in range(4):
        x = _least_squares(A, b, weights)
        residual = b - A @ x
        scale = max(1.4826 * float(np.median(np.abs(residual[usable]))), 0.05)
        weights = usable * np.maximum(1 - (residual / (4.7 * scale)) ** 2, 0) ** 2
    return x, weights, residual


def _least_squares(A: Array, b: Array, weights: Array) -> Array:
    weighted = (A * weights[:, None]).T
    return np.linalg.solve(weighted @ A + 1e-9 * np.eye(A.shape[1]), weighted @ b)


def _light(image: Image, places: Array) -> Array | None:
    """Linear light at places (K, S, 2) of the picture, shape (K, S, 3); None where they leave it."""
    low = np.floor(places.min(axis=(0, 1))).astype(int) - 1
    high = np.ceil(places.max(axis=(0, 1))).astype(int) + 2
    if (low < 0).any() or (high > image.shape[1::-1]).any():
        return None
    part = cv2.pow(image[low[1] : high[1], low[0] : high[0]].astype(np.float32) / 255, _GAMMA)
    u, v = (np.ascontiguousarray(x) for x in np.moveaxis((places - low).astype(np.float32), -1, 0))
    return cv2.remap(part, u, v, cv2.INTER_LINEAR).astype(float) + _PEDESTAL


def _inside_share(colours: Array, circle: Array, depth: Array) -> tuple[Array, NDArray[np.bool_]]:
    """How much of the ball is in each place along rays from its inside outwards, shape (K, S), and on which rays.

    A colour c is a mixture of the ball's, f, and the background's, g, at the ray's outer end: c = x f + y g. What is
    left of shading scales x, light and dark spots scale y: x / (x + y) is nearly free of both.

    Parameters
    ----------
    colours : ndarray, shape (K, S, 3)
        Linear light along the rays.
    circle : ndarray, shape (K, 2)
        Directions of the rays.
    depth : ndarray, shape (K,)
        Where the rays begin, as a share of their length to the outline.
    """
    ends = max(2, colours.shape[1] // 6)
    f, g = colours[:, :ends].mean(axis=1), colours[:, -ends:].mean(axis=1)
    f *= _limb_shade(f, circle, depth)[:, None]
    ff, gg, fg = np.sum(f * f, axis=1), np.sum(g * g, axis=1), np.sum(f * g, axis=1)
    determinant = ff * gg - fg**2
    usable = determinant > _LEAST_CONTRAST * ff * gg
    cf, cg = np.einsum("ksc,kc->ks", colours, f), np.einsum("ksc,kc->ks", colours, g)
    x = np.maximum(gg[:, None] * cf - fg[:, None] * cg, 0)
    y = np.maximum(ff[:, None] * cg - fg[:, None] * cf, 0)
    return x / np.maximum(x + y, 1e-12), usable


def _limb_shade(f: Array, circle: Array, depth: Array) -> Array:
    """How much lighter the ball is at its outline than where the rays begin, shape (K,).

    Light falls off towards one side: the slope that the rays' beginnings show goes on to the outline.
    """
    light = f @ np.median(f, axis=0)
    A = np.column_stack([np.ones(len(circle)), circle * depth[:, None]])
    weights = np.ones(len(light))
    for _ in range(3):
        slope = _least_squares(A, light, weights)
        off = np.abs(light - A @ slope)
        weights = 1 / np.maximum(off, 0.05 * float(np.median(light)))
    here, limb = A @ slope, slope[0] + circle @ slope[1:]
    return np.sqrt(np.clip(limb / np.maximum(here, 1e-6), 0.4, 2))
