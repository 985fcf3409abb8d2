"""Balls too small in a picture for an outline, measured by the centroid of their colour.

Every pixel around a blob is a mixture of the ball's colour and the background's. The share of the ball's, free of how
the ball is shaded, is what the centroid weights: a ball of four pixels has no edge to look at, but as much colour on
one side of its middle as on the other.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from ...numerics.arrays import Array, Bools
from ...numerics.least_squares import GAUSS_NEWTON, minimise
from .found_balls import Balls, FoundBall
from .swept_disc import STOPPING, DiscEquations, DiscFit

Image = NDArray[Any]

MAX_RADIUS = 3.0
"""Radius from which a ball's outline is measured instead, pixels."""
BLUR_SHARE = 0.35
"""Standard deviation of a moving ball's centre, as a share of the difference of its image's semi-axes."""
MAX_ELONGATION = 3.0
"""Length over width of a ball that moves: a blur of twice the diameter."""
_MIN_PIXELS, _MAX_PIXELS = 3, 80  # of a blob
_MAX_SIDE = 22  # of a blob's box, pixels: a small ball that moves
_MARGIN = 5  # pixels of background around a blob
_HALF_WINDOW, _EDGE_DISTANCE = 10, 2  # pixels: of a window around a spot; of a spot from the picture's edge
_CORE_RADIUS, _BALL_RADIUS = 1.5, 4.0  # pixels from a spot's middle: all of the ball's colour; with some of it
_CORE_SHARE = 0.25  # share of a blob's pixels that are the ball's colour alone
_MIN_LIGHT_SHARE = 0.25  # light of a pixel, as a share of ball or background, below which its colour is too uncertain
_NOISE_SHARE = 0.1  # share of the ball's colour that background has by chance
_RIM_WIDTH = 2.0  # how far blur carries the ball's colour beyond the pixels that are more the ball's than not
_MAX_ROD_SHIFT = 1.5  # how far a rod may have pulled the centroid aside, and stretched the ball, pixels
_RADIUS_SIGMA = 0.25  # relative error of the radius before
_MIN_DISC_PIXELS = 8  # of a ball that no rod hides, for its disc to be fitted
_MAX_BLOBS = 400  # beyond, it is the colour of the room
_MIN_SPACING = 2.0  # pixels within which two blobs are one
_SPECK_KERNEL = cv2.getStructuringElement(cv2.MORPH_CROSS, (3, 3))
_ITERATIONS = 4
_MIN_SIGMA = 0.12  # standard deviation of a still ball's centroid, pixels
_MIN_CONTRAST = 0.04  # squared sine of the angle between the colours of ball and background
_MIN_RADIUS = 1.0  # pixels
_MAX_SHARE_AROUND = 0.35  # share of a blob's colour that may lie around it


def find_small_balls(image: Image, light: Array, masks: Sequence[Image]) -> Balls:
    """Measure the small blobs of a colour.

    Parameters
    ----------
    image : ndarray of uint8, shape (h, w, 3)
    light : ndarray, shape (256,)
        Linear light of its levels.
    masks : sequence of ndarray of uint8, shape (h, w)
        Where the picture has the colour, by one or several ranges.
    """
    found: list[FoundBall] = []
    # Opened, the mask lets go of specks of its colour that touch a ball.
    candidates = [
        (m, mask, blobs)
        for m, mask in enumerate(masks)
        for blobs in (mask, cv2.morphologyEx(mask, cv2.MORPH_OPEN, _SPECK_KERNEL))
    ]
    measured_blobs: set[tuple[int, ...]] = set()
    for m, mask, blobs in candidates:
        count, labels, stats, _ = cv2.connectedComponentsWithStatsWithAlgorithm(blobs, 8, cv2.CV_32S, cv2.CCL_BBDT)
        if count > _MAX_BLOBS:  # the colour of the room rather than the ball's
            continue
        sides, areas = stats[:, 2:4].max(axis=1), stats[:, 4]
        small = (sides <= _MAX_SIDE) & (areas >= _MIN_PIXELS) & (areas <= _MAX_PIXELS)
        for k in np.flatnonzero(small[1:]) + 1:
            blob = (m, *stats[k].tolist())
            window = _window(mask.shape, blob[1:5])
            if window is None or blob in measured_blobs:  # nothing was taken from it when the mask was opened
                continue
            measured_blobs.add(blob)
            measured = _measured(light[image[window]], labels[window] == k, mask[window] > 0)
            if measured is None:
                continue
            centre = measured.centre + [window[1].start, window[0].start]
            if all(np.linalg.norm(centre - other.centre) > _MIN_SPACING for other in found):
                found.append(measured._replace(centre=centre))
    return Balls.of(found)


def measure_small_ball(image: Image, light: Array, place: Array) -> FoundBall | None:
    """Return the small ball near a place (2,), pixels; None if there is none.

    As `find_small_balls`, but without a range of colours: the pixels some distance away are the background.
    """
    size = image.shape[1::-1]
    corner = np.round(place).astype(int) - _HALF_WINDOW
    if (place < _EDGE_DISTANCE).any() or (place > np.array(size) - 1 - _EDGE_DISTANCE).any():
        return None
    window = tuple(
        slice(max(a, 0), min(a + 2 * _HALF_WINDOW + 1, n)) for a, n in ((corner[1], size[1]), (corner[0], size[0]))
    )
    start = np.array([window[1].start, window[0].start])
    v, u = np.indices(image[window].shape[:2])
    away = np.hypot(u + start[0] - place[0], v + start[1] - place[1])
    measured = _measured(light[image[window]], away < _CORE_RADIUS, away < _BALL_RADIUS)
    return None if measured is None else measured._replace(centre=measured.centre + start)


def _window(size: tuple[int, ...], box: Sequence[int]) -> tuple[slice, slice] | None:
    """Return the blob with its background; None at the picture's edge, where a part of it may be missing."""
    left, top, width, height = (int(n) for n in box)
    x0, y0, x1, y1 = left - _MARGIN, top - _MARGIN, left + width + _MARGIN, top + height + _MARGIN
    if left < 2 or top < 2 or left + width > size[1] - 2 or top + height > size[0] - 2:
        return None
    return slice(max(y0, 0), min(y1, size[0])), slice(max(x0, 0), min(x1, size[1]))


def _measured(light: Array, blob: Bools, coloured: Bools) -> FoundBall | None:
    """Return one blob as a ball, in the pixels of its window; None if it is none."""
    share = _share_of_ball(light, blob, coloured)
    if share is None:
        return None
    v, u = np.indices(blob.shape)
    places = np.stack([u, v], axis=-1).astype(float)
    core = _core(share, blob)
    if core[[0, -1]].any() or core[:, [0, -1]].any():
        return None  # a part of something larger
    centre = places[core].mean(axis=0)
    reach = np.linalg.norm(places[core] - centre, axis=1).max() + _RIM_WIDTH
    near = core
    for _ in range(_ITERATIONS):
        near = _distances(blob.shape, centre) <= reach
        weights = share * near
        total = float(weights.sum())
        if total < 1:
            return None
        centre = np.einsum("vu,vuk->k", weights, places) / total
    around = _distances(blob.shape, centre) <= reach + 2
    if float(share[around & ~near].sum()) > _MAX_SHARE_AROUND * total:
        return None
    off = places - centre
    spread = np.einsum("vu,vui,vuj->ij", weights, off, off) / total
    values, vectors = np.linalg.eigh(spread)
    path = float(np.sqrt(12 * max(values[1] - values[0], 0.0)))
    radius = float((np.sqrt(path**2 + np.pi * total) - path) / np.pi)  # the area is pi r^2 + 2 r path
    if not radius >= _MIN_RADIUS or radius + path / 2 > MAX_ELONGATION * radius:
        return None
    shape = (vectors * [radius, radius + path / 2]) @ vectors.T
    noise = float(np.std(share[~around])) if (~around).any() else _NOISE_SHARE
    scatter = noise * float(np.sqrt((off[near] ** 2).sum() / 2)) / total
    return FoundBall(centre, shape, float(np.sqrt(_MIN_SIGMA**2 + scatter**2 + (BLUR_SHARE * path / 2) ** 2)))


def _distances(shape: tuple[int, ...], centre: Array) -> Array:
    """Return how far every pixel of a window (h, w) is from a place (u, v) in it, pixels."""
    v, u = (np.arange(n) - x for n, x in zip(shape, centre[::-1], strict=True))
    return np.asarray(np.sqrt(u**2 + (v**2)[:, None]))


def _core(share: Array, blob: Bools) -> Bools:
    """Return the pixels around the one that is most the ball's which are more the ball's than not."""
    _, labels = cv2.connectedComponents((share >= 0.5).astype(np.uint8), connectivity=4)
    v, u = np.unravel_index(np.argmax(np.where(blob, share, -1)), share.shape)
    return np.asarray((labels == labels[v, u]) & (share >= 0.5)) if labels[v, u] else blob


def _share_of_ball(light: Array, blob: Bools, coloured: Bools) -> Array | None:
    """Return how much of every pixel is the ball's colour, 0 to 1; None where ball and background are too alike.

    A colour c is x f + y g, with f of the ball and g of the background. Shading scales x, light and dark spots scale y:
    x / (x + y) is nearly free of both, and where there is little light at all it is no ball.
    """
    beyond = cv2.distanceTransform((~coloured).astype(np.uint8), cv2.DIST_L2, 3) > 2.5
    if np.count_nonzero(beyond) < 8:
        return None
    g = _median_of(light[beyond])
    own = light[blob]
    squared = np.sum(own**2, axis=1) * (g @ g)
    away = (squared - (own @ g) ** 2) / np.maximum(squared, 1e-12)
    best = np.argsort(-away)[: max(3, int(_CORE_SHARE * len(own)))]
    f = own[best].mean(axis=0)
    ff, gg, fg = f @ f, g @ g, f @ g
    if ff * gg - fg**2 <= _MIN_CONTRAST * ff * gg:
        return None
    cf, cg = light @ f, light @ g
    x = np.maximum(gg * cf - fg * cg, 0) / (ff * gg - fg**2)
    y = np.maximum(ff * cg - fg * cf, 0) / (ff * gg - fg**2)
    share = x / np.maximum(x + y, _MIN_LIGHT_SHARE)
    least = max(_NOISE_SHARE, float(np.quantile(share[beyond], 0.9)))
    return np.asarray(np.clip((share - least) / max(1 - least, 1e-6), 0, 1))


def _median_of(rows: Array) -> Array:
    """Return the median of every column; `np.median` takes three times as long for so few."""
    low, high = (len(rows) - 1) // 2, len(rows) // 2
    ordered = np.partition(rows, [low, high], axis=0)
    return np.asarray((ordered[low] + ordered[high]) / 2)


def without_rod(image: Image, light: Array, ball: FoundBall, ways: Array, *, still: bool) -> FoundBall | None:
    """Measure a small ball again by the part of it that rods cannot hide.

    A disc that is swept along the ball's path and blurred is fitted to the shares of its colour, in all pixels that do
    not lie where a rod leaves the ball.

    Parameters
    ----------
    image : ndarray of uint8, shape (h, w, 3)
    light : ndarray, shape (256,)
        Linear light of its levels.
    ball : FoundBall
        As it was measured with the rods.
    ways : ndarray, shape (m, 2)
        Unit vectors from its middle along the rods; NaN for none.
    still : bool
        The ball does not move.

    Returns
    -------
    FoundBall or None
        None where too little is left of it.
    """
    centre = ball.centre
    values, vectors = np.linalg.eigh(ball.shape)
    radius, path = float(values[0]), 0.0 if still else 2 * float(values[1] - values[0])
    half = int(np.ceil(values[1] + _RIM_WIDTH)) + _MARGIN
    u0, v0 = (round(float(x)) - half for x in centre)
    if u0 < 0 or v0 < 0 or u0 + 2 * half >= image.shape[1] or v0 + 2 * half >= image.shape[0]:
        return None
    window = light[image[v0 : v0 + 2 * half + 1, u0 : u0 + 2 * half + 1]]
    v, u = np.indices(window.shape[:2])
    places = np.stack([u + u0, v + v0], axis=-1).astype(float)
    blob = np.linalg.norm(places - centre, axis=-1) < max(radius, 1.5)
    share = _share_of_ball(window, blob, np.linalg.norm(places - centre, axis=-1) < values[1] + 1)
    if share is None:
        return None
    fit = DiscFit.of(
        places,
        share,
        np.nan_to_num(ways),
        start=np.array([*centre, radius, *(path * vectors[:, 1])]),
        sigma=np.array([_MAX_ROD_SHIFT, _MAX_ROD_SHIFT, _RADIUS_SIGMA * radius, _MAX_ROD_SHIFT, _MAX_ROD_SHIFT]),
        free=np.array([True, True, True, not still, not still]),
    )
    found = minimise(
        fit.unknowns.start,
        fit.linearised,
        fit.moved,
        trial_cost=fit.trial_cost,
        damping=GAUSS_NEWTON,
        stopping=STOPPING,
    )
    return _fitted_ball(found.state, found.linearised())


def _fitted_ball(x: Array, last: DiscEquations) -> FoundBall | None:
    """Return the ball of a fitted disc: its centre, radius and path (5,), and the equations there; None where too few
    pixels are left.
    """
    if len(last.residuals) < _MIN_DISC_PIXELS:
        return None
    covariance = last.factor().covariance()[:2, :2]
    noise = max(float(np.sqrt(np.mean(last.residuals**2))), 1.0)
    sigma = noise * float(np.sqrt(np.trace(covariance) / 2))
    length = float(np.hypot(*x[3:]))
    way = x[3:] / length if length > 1e-9 else np.array([1.0, 0.0])
    grown = x[2] * np.eye(2) + length / 2 * np.outer(way, way)
    return FoundBall(x[:2], grown, float(np.sqrt(_MIN_SIGMA**2 + sigma**2 + (BLUR_SHARE * length / 2) ** 2)))
