"""Foreground images: log likelihood ratios of each pixel showing a performer against anything else.

On key frames it is known where a performer is, so they show the colours of performer and background. With a fixed
camera the background also stands still, and is compared pixel by pixel with a plate made of the key frames. Each of
several performers has foreground images of its own, for which the others count as something else: performers in
different clothes are distinguished by colour, in equal clothes a pixel may belong to any of them.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from ...numerics.arrays import Bools
from ...numerics.robust_kernels import NORMAL_MAD
from ...runtime.processes.shared_arrays import each_row
from .cast_shadows import CastShadows
from .known_pixels import KnownPixels
from .strangers import strangers_on, without_strangers

Bytes = NDArray[np.uint8]
Array = NDArray[np.float32]

MAX_LOG_RATIO = 4.0
"""Largest absolute value of a log likelihood ratio: no single pixel decides more."""
SURE_LOG_RATIO = 2.0
"""Log likelihood ratio at which a pixel counts as foreground, or as background, in full."""
LEVELS_PER_UNIT = 31.0
"""Grey levels of a foreground image per unit of the log likelihood ratio; level 128 is zero."""
EDGE_HALO = 0.25
"""Distance beyond the body's edge up to which pixels show enough of it to differ from the background, pixels."""
HISTOGRAM_BINS = 16
"""Histogram bins of each of the three colour channels."""
_DISTANCE_STEPS = 16
"""Steps of the distance from the background per unit of negative log likelihood; 255 is the largest."""
_OUTLIER_SHARE = 0.1
"""Share of pixels that show something that neither model predicts: bystanders, shadows, highlights."""
_MIN_SIGMA = 4.0


def log_ratio(foreground: Bytes) -> Array:
    """Decode foreground images to log likelihood ratios of the same shape, positive where the performer is likelier."""
    levels = np.arange(256, dtype=np.float32)  # looking a level up is faster than computing its ratio
    return np.asarray(((levels - np.float32(128)) / np.float32(LEVELS_PER_UNIT)).take(foreground))


def background_share(ratio: Array) -> Array:
    """Weight of pixels as background, 0 to 1, by their log likelihood ratios, same shape; undecided ones count 0."""
    return np.asarray(np.clip(-ratio / np.float32(SURE_LOG_RATIO), 0, 1))


def foreground_images(
    colour: Bytes,
    masks: Mapping[int, Bools],
    pixels_per_metre: float,
    fixed: bool,
    sure: Mapping[int, Bools] | None = None,
) -> Bytes:
    """Compute the foreground images of all performers together, for the frames of one view.

    Parameters
    ----------
    colour : ndarray of uint8, shape (N, h, w, 3)
        Blue, green, red.
    masks : mapping of int to ndarray of bool, shape (h, w)
        For some of the N frames: where the performers are.
    pixels_per_metre : float
        Scale at the performers.
    fixed : bool
        Whether the camera stands still.
    sure : mapping of int to ndarray of bool, shape (h, w), optional
        For the same frames: pixels that surely show performers, if the masks may be too large.

    Returns
    -------
    ndarray of uint8, shape (N, h, w)
        See `log_ratio`.
    """
    known = KnownPixels.of_masks(masks, pixels_per_metre, sure)
    return np.concatenate(list(performer_foregrounds(colour, known, fixed)))


def performer_foregrounds(colour: Bytes, known: KnownPixels, fixed: bool) -> Iterator[Bytes]:
    """Generate the foreground images of each of M performers, frame by frame, for one view.

    A performer of whom no pixels are known may have any colour.

    Parameters
    ----------
    colour : ndarray of uint8, shape (N, h, w, 3)
        Blue, green, red.
    known : KnownPixels
    fixed : bool
        Whether the camera stands still.

    Yields
    ------
    ndarray of uint8, shape (M, h, w)
        See `log_ratio`.
    """
    background = _histogram(colour, known.behind)
    plate, there = _plate(colour, known.behind)
    there &= fixed
    sigma = _plate_sigma(colour, plate, there)
    passing = _strangers(colour, known, plate, there, sigma)
    strangers = _histogram(colour, passing) if passing else None
    bodies = [_histogram(colour, shown, strangers) for shown in known.shown]
    shadows = CastShadows.learned(colour, known.behind, plate, sigma, known.pixels_per_metre) if fixed else None
    if shadows is not None:
        plate = shadows.plate
    tables = [
        _table(own, background, sigma, [other for j, other in enumerate(bodies) if j != i], strangers)
        for i, own in enumerate(bodies)
    ]
    steps = _DISTANCE_STEPS / (2 * sigma**2)
    unknown = np.where(there, 0, 255).astype(np.uint8)
    for image in each_row(colour):
        apart = cv2.absdiff(image, plate)
        b, g, r = cv2.split(cv2.multiply(apart, apart, scale=steps))
        distance = cv2.min(cv2.add(cv2.add(b, g), r), 254) | unknown  # products and sums end at 255
        channels = cv2.split(image)
        if shadows is not None:
            shadows.shade(distance, channels, _DISTANCE_STEPS)
        places = _bins_of(channels).astype(np.intp)
        places <<= 8
        places |= distance
        images = np.empty((len(tables), *places.shape), np.uint8)
        for table, result in zip(tables, images, strict=True):
            table.take(places, out=result, mode="clip")
        yield images


def strangers_beside(colour: Bytes, masks: Mapping[int, Bools], pixels_per_metre: float) -> dict[int, Bools]:
    """Find the pixels that show strangers on some frames of a camera that stands still; parameters as of
    `foreground_images`, result as of `strangers_on`.
    """
    known = KnownPixels.of_masks(masks, pixels_per_metre)
    plate, there = _plate(colour, known.behind)
    return _strangers(colour, known, plate, there, _plate_sigma(colour, plate, there))


def _strangers(colour: Bytes, known: KnownPixels, plate: Bytes, there: Bools, sigma: float) -> dict[int, Bools]:
    unlike = float(np.sqrt(2 * MAX_LOG_RATIO)) * sigma
    return strangers_on(colour, known.behind, plate, there, unlike=unlike, scale=known.pixels_per_metre)


def _table(body: Array, background: Array, sigma: float, others: Sequence[Array], strangers: Array | None) -> Bytes:
    """Table of foreground values by the bin of a pixel's colour and its distance from the plate in steps.

    The last distance is for pixels where no plate is known. Colours of other performers weigh so little that a colour
    that all wear may still reach the largest value, and so do those of strangers that the performer wears as well.
    """
    volume = (256 / HISTOGRAM_BINS) ** 3  # of a bin of the histograms, whose values are per bin
    nearness = volume * np.exp(-np.arange(255) / _DISTANCE_STEPS) / (np.sqrt(2 * np.pi) * sigma) ** 3
    still = ((1 - _OUTLIER_SHARE) * np.minimum(nearness, 1)).astype(np.float32)
    values = np.empty((len(body), len(still) + 1), np.float32)  # a million: worked on in place
    np.add(_OUTLIER_SHARE * background[:, None], still, out=values[:, :-1])
    values[:, -1] = background
    for other in others:
        values += np.float32(np.exp(-MAX_LOG_RATIO)) * other[:, None]
    if strangers is not None:
        values += np.float32(_OUTLIER_SHARE) * np.maximum(strangers - body, 0)[:, None]
    np.divide(body[:, None], values, out=values)
    cv2.log(values, values)
    np.clip(values, -MAX_LOG_RATIO, MAX_LOG_RATIO, out=values)
    values *= np.float32(LEVELS_PER_UNIT)
    values += np.float32(128.5)
    return values.astype(np.uint8)


def bins(image: Bytes) -> NDArray[np.uint16]:
    """Histogram bin of every pixel of an image (h, w, 3)."""
    return _bins_of(cv2.split(image))


def _bins_of(channels: Sequence[Any]) -> NDArray[np.uint16]:
    """Histogram bin of every pixel of an image's three channels (h, w)."""
    b, g, r = (channel // (256 // HISTOGRAM_BINS) for channel in channels)
    places = b.astype(np.uint16)
    for channel in (g, r):
        places *= HISTOGRAM_BINS
        places += channel
    return places


def _histogram(colour: Bytes, regions: Mapping[int, Bools], strangers: Array | None = None) -> Array:
    """Smoothed colour histogram of regions of frames, shape (`HISTOGRAM_BINS`^3,); uniform without any pixels. The
    colours of strangers, who may stand in the regions, count less.
    """
    frames = [
        np.bincount(bins(colour[frame])[region], minlength=HISTOGRAM_BINS**3) for frame, region in regions.items()
    ]
    frames = [counts for counts in frames if counts.any()]
    share = smoothed(np.sum(frames, axis=0, dtype=float) if frames else np.ones(HISTOGRAM_BINS**3))
    share /= max(float(share.sum()), 1e-9)
    if strangers is not None and len(frames) > 1:
        share = without_strangers(share, [smoothed(counts / counts.sum()) for counts in frames], strangers)
    return ((1 - _OUTLIER_SHARE) * share + _OUTLIER_SHARE / len(share)).astype(np.float32)


def smoothed(counts: NDArray[np.float64]) -> NDArray[np.float64]:
    """Blur a colour histogram, (HISTOGRAM_BINS^3,), over neighbouring bins."""
    cube = counts.reshape(HISTOGRAM_BINS, -1)  # in double precision: see `smoothed_images`
    for _ in range(3):  # blurs one axis of colour, then goes on to the next
        cube = cv2.GaussianBlur(cube, (1, 0), 0, sigmaY=0.7, borderType=cv2.BORDER_REPLICATE)
        cube = (
            cube.reshape(HISTOGRAM_BINS, HISTOGRAM_BINS, HISTOGRAM_BINS).transpose(1, 2, 0).reshape(HISTOGRAM_BINS, -1)
        )
    return np.asarray(cube.ravel())


def _plate(colour: Bytes, behind: Mapping[int, Bools]) -> tuple[Bytes, Bools]:
    """Background plate: the mean of the background over some frames, and where it is known."""
    total = np.zeros(colour.shape[1:], np.float32)
    count = np.zeros(colour.shape[1:3], np.float32)
    for frame, region in behind.items():
        cv2.accumulate(colour[frame], total, region.astype(np.uint8))
        count += region
    return np.round(total / np.maximum(count, 1)[..., None]).astype(np.uint8), count > 0


def _plate_sigma(colour: Bytes, plate: Bytes, known: Bools) -> float:
    """Robust standard deviation of the frames from the plate, grey levels (of 255); most pixels show background."""
    if not known.any():
        return _MIN_SIGMA
    some = colour[:: max(1, len(colour) // 8)]
    places = np.flatnonzero(known)[::7]
    apart = np.concatenate([cv2.absdiff(image, plate).reshape(-1, 3).take(places, axis=0) for image in some])
    upto = np.cumsum(np.bincount(apart.ravel(), minlength=256))  # of whole levels; quicker than sorting them
    median = np.searchsorted(upto, [(apart.size - 1) // 2, apart.size // 2], side="right").mean()
    return max(2 * NORMAL_MAD * float(median), _MIN_SIGMA)
