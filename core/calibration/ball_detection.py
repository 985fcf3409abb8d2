"""Coloured balls in one picture, to a fraction of a pixel.

A colour filter finds blobs; rays from a blob's middle then cross its edge, where ball and background mix in linear
light. The place of the edge on every ray follows from how much of each is there, however the ball is shaded, and an
ellipse through these places is the ball's outline. Outlines that are not ellipses are rejected. Balls that are too
small for that are measured in `core.calibration.small_balls`.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from ..capture.colours import GAMMA, Colour, to_hsv
from ..numerics.arrays import Array
from ..numerics.robust_kernels import NORMAL_MAD
from .coloured_spots import coloured_spots
from .small_balls import BLUR_SHARE, LARGEST_SMALL, LONGEST, find_small_balls, without_rod

Image = NDArray[Any]

_EVEN = 1.0  # deviation of the blur, pixels
_PEDESTAL = 0.02  # keeps a black background's colour from being no direction at all
_LIGHT = (np.arange(256) / 255) ** GAMMA + _PEDESTAL
_SPECKS = cv2.getStructuringElement(cv2.MORPH_CROSS, (3, 3))
_RAYS = 40  # from the middle of a blob across its edge
_ANGLES = 2 * np.pi * np.arange(_RAYS) / _RAYS
_CIRCLE = np.column_stack([np.cos(_ANGLES), np.sin(_ANGLES)])
_BASIS = np.column_stack([np.ones(_RAYS), _CIRCLE, np.cos(2 * _ANGLES), np.sin(2 * _ANGLES)])
_CIRCLE_TERMS, _ELLIPSE_TERMS = 3, 5
_PLACES = 11  # on a ray
_ENDS = 2  # of these, at either end of a ray, that are ball alone or background alone
_REACHES = (2.5, 1.5)  # how far to both sides of the outline a ray goes at least: first a search, then near the limb
_LEAST_AREA = 12  # pixels
_LARGEST_SHARE = 0.4  # of the picture's height
_LEAST_SOLIDITY = 0.6  # area over that of the convex hull: less is no disc, even half covered
_MOST_BLOBS = 60  # the largest that are looked at: more are the room
_LEAST_CONTRAST = 0.02  # squared sine of the angle between the colours of ball and background
_SHARED = 3.0  # neighbouring rays share pixels: so many count as one
_HOLD = np.cos(np.radians(42))
_FLOOR = 0.1  # standard deviation that the best of outlines leaves, pixels
_MIXED = 3.0  # how many times the share that a ball may have in a pixel is contained in the whole
_LEAST_CHANGE, _SURE_CHANGE = 8.0, 5.0  # of what passes from the background: levels, and deviations of the noise


@dataclass(frozen=True)
class _Tolerance:
    """What is accepted as a ball.

    Attributes
    ----------
    coverage : float
        Least share of the outline that agrees with the fit.
    noise, roundness : float
        Largest deviation of that part from the fit, root mean square: pixels, plus a share of the radius.
    """

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

    def __getitem__(self, which: NDArray[Any] | slice | list[int]) -> Balls:
        return Balls(self.centres[which], self.shapes[which], self.sigma[which])

    @property
    def semi_axes(self) -> Array:
        """Return the major and minor semi-axes of the outlines, shape (n, 2), pixels."""
        return np.linalg.eigvalsh(self.shapes)[:, ::-1]

    @classmethod
    def joined(cls, balls: Sequence[Balls]) -> Balls:
        """Return several sets of balls as one."""
        if not balls:
            return cls(np.empty((0, 2)), np.empty((0, 2, 2)), np.empty(0))
        return cls(*(np.concatenate([getattr(b, item.name) for b in balls]) for item in fields(cls)))


@dataclass(frozen=True, eq=False)
class Picture:
    """A picture to look for balls in.

    Attributes
    ----------
    even : ndarray of uint8, shape (h, w, 3)
        Blue, green, red, about as sharp in brightness as in colour: video keeps a colour for every other pixel alone,
        and an edge that is sharp in the one and soft in the other would seem to lie elsewhere than it does.
    hsv : ndarray of uint8, shape (h, w, 3)
        By `to_hsv`, as sharp as it is.
    passing : ndarray of uint8, shape (h, w, 3), optional
        By `to_hsv`: what passes before a background that is known, brought out of it; black elsewhere.
    """

    even: Image
    hsv: Image
    passing: Image | None = None

    @classmethod
    def of(cls, image: Image, background: Image | None = None) -> Picture:
        """Return the picture of an image in blue, green and red, uint8, shape (h, w, 3).

        `background` is that of a stationary camera, by `background_of`.
        """
        even = cv2.GaussianBlur(image, (0, 0), _EVEN)
        return cls(even, to_hsv(image), None if background is None else to_hsv(_brought_out(even, background)))


def background_of(images: Sequence[Image]) -> Image:
    """Return the background of a stationary camera, the median of some of its pictures, as `Picture.of` takes it."""
    return cv2.GaussianBlur(np.median(images, axis=0).astype(np.uint8), (0, 0), _EVEN)


def _brought_out(even: Image, background: Image) -> Image:
    """Return what passes before a background, as it would look if the exposure had seen it alone.

    A small ball that moves, or a soft lens, leaves a mixture of the ball's colour and the background's in each pixel,
    too pale for the ball's. Its difference from the background goes the ball's way, and is taken several times.
    """
    differs = np.abs(even.astype(np.int16) - background).max(axis=2)
    noise = NORMAL_MAD * float(np.median(differs))
    passes = differs > max(_LEAST_CHANGE, _SURE_CHANGE * noise)
    out = np.zeros_like(even)
    behind = _LIGHT[background[passes]] - _PEDESTAL
    light = behind + _MIXED * (_LIGHT[even[passes]] - _PEDESTAL - behind)
    out[passes] = (255 * np.clip(light, 0, 1) ** (1 / GAMMA)).round()
    return out


def find_balls(picture: Picture, colour: Colour) -> Balls:
    """Return all balls of a colour in a picture, the largest first."""
    image, coloured = picture.even, colour.mask(picture.hsv)
    mask = cv2.morphologyEx(coloured, cv2.MORPH_OPEN, _SPECKS)
    outlines, _ = cv2.findContours(mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    blobs = sorted(filter(_is_compact, outlines), key=len, reverse=True)[:_MOST_BLOBS]
    balls = Balls.joined([_ellipse_of(cv2.convexHull(blob)) for blob in blobs])
    balls = balls[2 * balls.semi_axes[:, 0] < _LARGEST_SHARE * image.shape[0]]
    balls, good = _refined(image, balls, np.zeros((len(balls), _RAYS), bool), _SEARCHED)
    balls = balls[good & ~_is_small(balls)]
    masks = [coloured, colour.paler().mask(picture.hsv)]
    if picture.passing is not None:
        masks.append(colour.mask(picture.passing))
    small = find_small_balls(image, _LIGHT, masks)
    tiny = Balls(small.centres, small.shapes, small.sigma)
    return Balls.joined([balls, tiny[_is_small(tiny) & ~_within_others(tiny, balls)]])


def find_spots(picture: Picture, colour: Colour, most: int) -> Balls:
    """Return at most `most` small balls of a colour, the most conspicuous first, even in a room with that colour."""
    pure = colour.pure()
    if pure is None:
        return Balls.joined([])
    spots = coloured_spots(picture.even, _LIGHT, colour.paler().mask(picture.hsv), pure, most=most)
    return Balls(spots.centres, spots.shapes, spots.sigma)


def _is_small(balls: Balls) -> NDArray[np.bool_]:
    """Return which balls are measured by their colour's centroid: they are too small for an outline."""
    return np.asarray(balls.semi_axes[:, 1] < LARGEST_SMALL)


def _within_others(balls: Balls, others: Balls) -> NDArray[np.bool_]:
    """Return which balls are parts of others."""
    apart = np.linalg.norm(balls.centres[:, None] - others.centres, axis=-1)
    return np.asarray((apart < others.semi_axes[:, 0] + 1).any(axis=1))


def without_rods(
    picture: Picture, balls: Balls, ends: Array, *, still: bool = False
) -> tuple[Balls, NDArray[np.bool_]]:
    """Measure balls again without the parts of their outlines that rods hide.

    Parameters
    ----------
    balls : Balls
        n of them.
    ends : ndarray, shape (n, m, 2)
        Where the rods lead to from the middle of each, pixels; NaN for none.
    still : bool
        The balls do not move: their outlines are as long and wide, one to the other, as they are given.

    Returns
    -------
    balls : Balls
    good : ndarray of bool, shape (n,)
        Which of them are still accepted as balls.
    """
    ways = ends - balls.centres[:, None]
    ways = ways / np.maximum(np.linalg.norm(ways, axis=-1, keepdims=True), 1e-9)
    small = _is_small(balls)
    balls = _small_without_rods(picture, balls, small, ways, still=still)
    if small.all():
        return balls, small
    spokes = _CIRCLE @ balls.shapes
    spokes /= np.linalg.norm(spokes, axis=-1, keepdims=True)
    hidden = (spokes @ np.swapaxes(ways, 1, 2) > _HOLD).any(axis=-1)
    measured, good = _refined(picture.even, balls, hidden, _MEASURED, _CIRCLE_TERMS if still else _ELLIPSE_TERMS)
    kept = [np.where(small.reshape(-1, *[1] * (x.ndim - 1)), x, y) for x, y in _columns(balls, measured)]
    return Balls(*kept), small | good


def _small_without_rods(picture: Picture, balls: Balls, small: NDArray[np.bool_], ways: Array, *, still: bool) -> Balls:
    """Return the small balls measured without what rods hide, where enough is left of them."""
    if not small.any():
        return balls
    columns = [balls.centres.copy(), balls.shapes.copy(), balls.sigma.copy()]
    for k in np.flatnonzero(small):
        own = balls.centres[k], balls.shapes[k]
        measured = without_rod(picture.even, _LIGHT, own, ways[k], still=still)
        if measured is not None:
            for column, value in zip(columns, measured, strict=True):
                column[k] = value
    return Balls(*columns)


def _is_compact(outline: Image) -> bool:
    if len(outline) < 6:
        return False
    hull = cv2.contourArea(cv2.convexHull(outline))
    # A contour goes through the outermost pixels' centres: the area of n of them is half a pixel less all round.
    edge = len(outline) / 2
    return cv2.contourArea(outline) + edge >= max(_LEAST_AREA, _LEAST_SOLIDITY * (hull + edge))


def _ellipse_of(outline: Image) -> Balls:
    """Return the ellipse with the moments of what a contour encloses."""
    m = cv2.moments(outline)
    area = max(m["m00"], 1e-9)
    values, vectors = np.linalg.eigh(np.array([[m["mu20"], m["mu11"]], [m["mu11"], m["mu02"]]]) / area)
    half = 2 * np.sqrt(np.maximum(values, 0)) + 0.5
    return Balls(np.array([[m["m10"], m["m01"]]]) / area, ((vectors * half) @ vectors.T)[None], np.zeros(1))


def _refined(
    image: Image, balls: Balls, hidden: NDArray[np.bool_], tolerance: _Tolerance, terms: int = _ELLIPSE_TERMS
) -> tuple[Balls, NDArray[np.bool_]]:
    """Return the outlines near given ones, and which are balls'; `hidden` (n, rays) are rays not to look at."""
    good = np.ones(len(balls), bool)
    if not len(balls):
        return balls, good
    for nearest in _REACHES:
        fit = _outline_fit(image, balls, hidden, nearest, terms)
        axes = fit.balls.semi_axes
        with np.errstate(invalid="ignore"):
            good &= (axes[:, 1] > 1) & (axes[:, 0] < LONGEST * axes[:, 1])
        kept = [np.where(good.reshape(-1, *[1] * (x.ndim - 1)), x, y) for x, y in _columns(fit.balls, balls)]
        balls = Balls(*kept)
    major, minor = balls.semi_axes.T
    good &= (fit.coverage >= tolerance.coverage) & (fit.residual <= tolerance.noise + tolerance.roundness * minor)
    sigma = np.sqrt(balls.sigma**2 + _FLOOR**2 + (BLUR_SHARE * (major - minor)) ** 2)
    return Balls(balls.centres, balls.shapes, sigma), good


def _columns(*balls: Balls) -> Iterator[tuple[Array, ...]]:
    for item in fields(Balls):
        yield tuple(getattr(b, item.name) for b in balls)


@dataclass(frozen=True, eq=False)
class _EllipseFit:
    """Outlines fitted to the edges on rays.

    Attributes
    ----------
    balls : Balls
        With NaN where nothing could be fitted.
    coverage : ndarray, shape (n,)
        Share of the rays that agree with it.
    residual : ndarray, shape (n,)
        Of these, root mean square, pixels.
    """

    balls: Balls
    coverage: Array
    residual: Array


def _outline_fit(image: Image, balls: Balls, hidden: NDArray[np.bool_], nearest: float, terms: int) -> _EllipseFit:
    """Return the outlines through the edges near given ones.

    In the coordinates in which the given ellipse is the unit circle, the outline's distance from the middle is fitted
    by 1 + r + x cos + y sin + e cos 2 + f sin 2: a shift, and to the first order another ellipse. The first three
    terms alone keep its form.
    """
    spokes = _CIRCLE @ balls.shapes
    lengths = np.linalg.norm(spokes, axis=-1)
    major, minor = balls.semi_axes.T
    reach = np.minimum(np.maximum(nearest, 0.15 * minor) + 1.2 * (major - minor), major)
    steps = reach[:, None] * np.linspace(-1, 1, _PLACES)
    along = (lengths[..., None] + steps[:, None]) / lengths[..., None]
    places = balls.centres[:, None, None] + along[..., None] * spokes[:, :, None]
    light = _light(image, places)
    inside, usable = _inside_share(light)
    step = steps[:, 1:2] - steps[:, :1]
    edges = steps[:, :1] - step / 2 + step * inside.sum(axis=-1)
    usable &= ~hidden & (np.abs(edges) < 0.8 * reach[:, None]) & _within(image, places)
    x, weights, residual = _robust_fit(_BASIS[:, :terms] * lengths[..., None], edges, usable)
    x = np.pad(x, ((0, 0), (0, _ELLIPSE_TERMS - terms)))
    agreeing = weights > 0.2
    count = agreeing.sum(axis=1)
    scale = np.sqrt(np.sum(agreeing * residual**2, axis=1) / np.maximum(count, 1))
    r, e, f = x[:, 0], x[:, 3], x[:, 4]
    change = np.stack([np.stack([1 + r + e, f], axis=-1), np.stack([f, 1 + r - e], axis=-1)], axis=-2)
    shapes = balls.shapes @ change
    enough = count >= _SEARCHED.coverage * _RAYS
    shapes[~enough] = np.nan
    fitted = Balls(
        balls.centres + np.einsum("nij,nj->ni", balls.shapes, x[:, 1:3]),
        (shapes + np.swapaxes(shapes, 1, 2)) / 2,
        scale * np.sqrt(_SHARED * _centre_variance(weights, terms)),
    )
    return _EllipseFit(fitted, count / _RAYS, scale)


def _centre_variance(weights: Array, terms: int) -> Array:
    """Return the variance of a centre's coordinates for rays of unit variance and these weights, shape (n,)."""
    basis = _BASIS[:, :terms]
    N = np.einsum("nk,ki,kj->nij", weights, basis, basis) + 1e-6 * np.eye(terms)
    return np.asarray(np.trace(np.linalg.inv(N)[:, 1:3, 1:3], axis1=1, axis2=2) / 2)


def _robust_fit(A: Array, b: Array, usable: NDArray[np.bool_]) -> tuple[Array, Array, Array]:
    """Least squares with Tukey's weights: solutions (n, 5), weights and residuals (n, rays)."""
    weights = usable.astype(float)
    for _ in range(4):
        x = _least_squares(A, b, weights)
        residual = b - np.einsum("nki,ni->nk", A, x)
        scale = np.maximum(NORMAL_MAD * _median_of(np.abs(residual), usable), 0.05)
        weights = usable * np.maximum(1 - (residual / (4.7 * scale[:, None])) ** 2, 0) ** 2
    return x, weights, residual


def _median_of(values: Array, usable: NDArray[np.bool_]) -> Array:
    """Return the median of the usable values of every row; 0 where there are none."""
    ordered = np.sort(np.where(usable, values, np.inf), axis=1)
    middle = np.maximum(usable.sum(axis=1) - 1, 0) // 2
    medians = ordered[np.arange(len(values)), middle]
    return np.where(np.isfinite(medians), medians, 0.0)


def _least_squares(A: Array, b: Array, weights: Array) -> Array:
    """Return the solutions (n, m) of n weighted systems (n, rays, m)."""
    weighted = np.swapaxes(A * weights[..., None], 1, 2)
    return np.linalg.solve(weighted @ A + 1e-9 * np.eye(A.shape[-1]), weighted @ b[..., None])[..., 0]


def _within(image: Image, places: Array) -> NDArray[np.bool_]:
    """Return whether rays (n, K, S, 2) stay in the picture."""
    return np.asarray(((places >= 0) & (places <= np.array(image.shape[1::-1]) - 1)).all(axis=(-1, -2)))


def _light(image: Image, places: Array) -> Array:
    """Return the linear light at places (..., 2) of the picture, shape (..., 3)."""
    u, v = np.moveaxis(places.reshape(-1, places.shape[-2], 2).astype(np.float32), -1, 0)
    levels = cv2.remap(image, u.copy(), v.copy(), cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(_LIGHT[levels].reshape(*places.shape[:-1], 3))


def _inside_share(light: Array) -> tuple[Array, NDArray[np.bool_]]:
    """Return the share of the ball's colour along rays from its inside outwards, and the rays on which it is defined.

    A colour c is a mixture of the ball's, f, at a ray's inner end and the background's, g, at its outer end: c = x f +
    y g. Shading scales x, light and dark spots scale y: x / (x + y) is nearly free of both.

    Parameters
    ----------
    light : ndarray, shape (n, K, S, 3)
        Along the rays.
    """
    f, g = light[..., :_ENDS, :].mean(axis=-2), light[..., -_ENDS:, :].mean(axis=-2)
    ff, gg, fg = np.sum(f * f, axis=-1), np.sum(g * g, axis=-1), np.sum(f * g, axis=-1)
    usable = ff * gg - fg**2 > _LEAST_CONTRAST * ff * gg
    cf, cg = (np.einsum("nksc,nkc->nks", light, end) for end in (f, g))
    x = np.maximum(gg[..., None] * cf - fg[..., None] * cg, 0)
    y = np.maximum(ff[..., None] * cg - fg[..., None] * cf, 0)
    return x / np.maximum(x + y, 1e-12), usable


def marked(image: Image, balls: Balls) -> Image:
    """Return a copy of a picture with a white and black ellipse round every ball."""
    shown = image.copy()
    for centre, shape in zip(balls.centres, balls.shapes, strict=True):
        for grow, colour in ((3.0, (0, 0, 0)), (2.0, (255, 255, 255))):
            ring = centre + _CIRCLE @ (shape + grow * np.eye(2))
            cv2.polylines(shown, [(16 * ring).round().astype(np.int32)], True, colour, 1, cv2.LINE_AA, 4)
    return shown
