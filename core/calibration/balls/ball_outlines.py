"""Outlines of coloured balls: ellipses through the places where rays from the middle of a ball cross its edge.

Ball and background mix in linear light there. The place of the edge on a ray follows from how much of each there is,
however the ball is shaded.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from ...capture.linear_light import LINEAR_LIGHT
from ...numerics.arrays import Array
from ...numerics.robust_kernels import NORMAL_MAD
from .found_balls import Balls
from .small_balls import BLUR_SHARE, MAX_ELONGATION

Image = NDArray[Any]

LIGHT = LINEAR_LIGHT + 0.02
"""Linear light of the levels 0 to 255, a little brighter: the colour of a black background would have no direction."""
RAY_COUNT = 40
"""Rays from the middle of a blob across its edge."""
_ANGLES = 2 * np.pi * np.arange(RAY_COUNT) / RAY_COUNT
CIRCLE = np.column_stack([np.cos(_ANGLES), np.sin(_ANGLES)])
"""Points of the unit circle, in which the rays end."""
_BASIS = np.column_stack([np.ones(RAY_COUNT), CIRCLE, np.cos(2 * _ANGLES), np.sin(2 * _ANGLES)])
CIRCLE_TERMS, ELLIPSE_TERMS = 3, 5
"""Terms of `_BASIS` that shift and scale an outline, and that also change its form."""
_RAY_SAMPLES = 11  # on a ray
_END_SAMPLES = 2  # of these, at either end of a ray, that are ball alone or background alone
_REACHES = (2.5, 1.5)  # how far to both sides of the outline a ray goes at least: first a search, then near the limb
_MIN_CONTRAST = 0.02  # squared sine of the angle between the colours of ball and background
_RAYS_PER_OBSERVATION = 3.0  # rays that count as one observation, as neighbouring ones share pixels
_MIN_SIGMA = 0.1  # standard deviation that the best of outlines leaves, pixels


@dataclass(frozen=True)
class Tolerance:
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


SEARCH_TOLERANCE = Tolerance(0.4, 0.45, 0.1)
"""When balls are searched for."""
MEASURING_TOLERANCE = Tolerance(0.4, 0.3, 0.06)
"""When a ball that was found is measured again without the rods that hide it."""


def refined_outlines(
    image: Image, balls: Balls, hidden: NDArray[np.bool_], tolerance: Tolerance, terms: int = ELLIPSE_TERMS
) -> tuple[Balls, NDArray[np.bool_]]:
    """Return the outlines near given ones, and which are balls'; `hidden` (n, rays) are rays not to look at."""
    good = np.ones(len(balls), bool)
    if not len(balls):
        return balls, good
    for nearest in _REACHES:
        fit = _outline_fit(image, balls, hidden, nearest, terms)
        axes = fit.balls.semi_axes
        with np.errstate(invalid="ignore"):
            good &= (axes[:, 1] > 1) & (axes[:, 0] < MAX_ELONGATION * axes[:, 1])
        balls = fit.balls.where(good, balls)
    major, minor = balls.semi_axes.T
    good &= (fit.coverage >= tolerance.coverage) & (fit.residual <= tolerance.noise + tolerance.roundness * minor)
    sigma = np.sqrt(balls.sigma**2 + _MIN_SIGMA**2 + (BLUR_SHARE * (major - minor)) ** 2)
    return Balls(balls.centres, balls.shapes, sigma), good


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
    spokes = CIRCLE @ balls.shapes
    lengths = np.linalg.norm(spokes, axis=-1)
    major, minor = balls.semi_axes.T
    reach = np.minimum(np.maximum(nearest, 0.15 * minor) + 1.2 * (major - minor), major)
    steps = reach[:, None] * np.linspace(-1, 1, _RAY_SAMPLES)
    along = (lengths[..., None] + steps[:, None]) / lengths[..., None]
    places = balls.centres[:, None, None] + along[..., None] * spokes[:, :, None]
    light = _light(image, places)
    inside, usable = _inside_share(light)
    step = steps[:, 1:2] - steps[:, :1]
    edges = steps[:, :1] - step / 2 + step * inside.sum(axis=-1)
    usable &= ~hidden & (np.abs(edges) < 0.8 * reach[:, None]) & _within(image, places)
    x, weights, residual = _robust_fit(_BASIS[:, :terms] * lengths[..., None], edges, usable)
    x = np.pad(x, ((0, 0), (0, ELLIPSE_TERMS - terms)))
    agreeing = weights > 0.2
    count = agreeing.sum(axis=1)
    scale = np.sqrt(np.sum(agreeing * residual**2, axis=1) / np.maximum(count, 1))
    r, e, f = x[:, 0], x[:, 3], x[:, 4]
    change = np.stack([np.stack([1 + r + e, f], axis=-1), np.stack([f, 1 + r - e], axis=-1)], axis=-2)
    shapes = balls.shapes @ change
    enough = count >= SEARCH_TOLERANCE.coverage * RAY_COUNT
    shapes[~enough] = np.nan
    fitted = Balls(
        balls.centres + np.einsum("nij,nj->ni", balls.shapes, x[:, 1:3]),
        (shapes + np.swapaxes(shapes, 1, 2)) / 2,
        scale * np.sqrt(_RAYS_PER_OBSERVATION * _centre_variance(weights, terms)),
    )
    return _EllipseFit(fitted, count / RAY_COUNT, scale)


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
    return np.asarray(LIGHT[levels].reshape(*places.shape[:-1], 3))


def _inside_share(light: Array) -> tuple[Array, NDArray[np.bool_]]:
    """Return the share of the ball's colour along rays from its inside outwards, and the rays on which it is defined.

    A colour c is a mixture of the ball's, f, at a ray's inner end and the background's, g, at its outer end: c = x f +
    y g. Shading scales x, light and dark spots scale y: x / (x + y) is nearly free of both.

    Parameters
    ----------
    light : ndarray, shape (n, K, S, 3)
        Along the rays.
    """
    f, g = light[..., :_END_SAMPLES, :].mean(axis=-2), light[..., -_END_SAMPLES:, :].mean(axis=-2)
    ff, gg, fg = np.sum(f * f, axis=-1), np.sum(g * g, axis=-1), np.sum(f * g, axis=-1)
    usable = ff * gg - fg**2 > _MIN_CONTRAST * ff * gg
    cf, cg = (np.einsum("nksc,nkc->nks", light, end) for end in (f, g))
    x = np.maximum(gg[..., None] * cf - fg[..., None] * cg, 0)
    y = np.maximum(ff[..., None] * cg - fg[..., None] * cf, 0)
    return x / np.maximum(x + y, 1e-12), usable
