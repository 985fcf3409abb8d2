"""Coloured balls in one picture, to a fraction of a pixel.

A colour filter finds blobs, and their outlines are fitted in `core.calibration.balls.ball_outlines`; those that are not
ellipses are rejected. Balls that are too small for that are measured in `core.calibration.balls.small_balls`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from ...capture.colours import Colour, to_hsv
from ...capture.linear_light import GAMMA, LINEAR_LIGHT
from ...numerics.arrays import Array
from ...numerics.median_image import median_image
from ...numerics.robust_kernels import NORMAL_MAD
from .ball_outlines import (
    CIRCLE,
    CIRCLE_TERMS,
    ELLIPSE_TERMS,
    LIGHT,
    MEASURING_TOLERANCE,
    RAY_COUNT,
    SEARCH_TOLERANCE,
    refined_outlines,
)
from .coloured_spots import coloured_spots
from .found_balls import Balls, FoundBall
from .small_balls import MAX_RADIUS, find_small_balls, without_rod

Image = NDArray[Any]

_BLUR_SIGMA = 1.0  # deviation of the blur, pixels
_SPECK_KERNEL = cv2.getStructuringElement(cv2.MORPH_CROSS, (3, 3))
_MIN_AREA = 12  # pixels
_MAX_HEIGHT_SHARE = 0.4  # of the picture's height
_MIN_SOLIDITY = 0.6  # area over that of the convex hull: less is no disc, even half covered
_MAX_BLOBS = 60  # the largest that are looked at: more are the room
_ROD_COSINE = np.cos(np.radians(42))  # of the angle from a rod within which it may hide a ball's outline
_UNMIXING_RATIO = 3.0  # how many times the share that a ball may have in a pixel is contained in the whole
_MIN_CHANGE, _MIN_CHANGE_SIGMAS = 8.0, 5.0  # of what passes from the background: levels, and deviations of the noise


@dataclass(frozen=True, eq=False)
class Picture:
    """A picture in which balls are looked for.

    Attributes
    ----------
    even : ndarray of uint8, shape (h, w, 3)
        Blue, green, red, blurred until brightness is about as soft as colour: video stores colour for every other
        pixel only, and an edge that is sharp in one and soft in the other would seem displaced.
    hsv : ndarray of uint8, shape (h, w, 3)
        By `to_hsv`, as sharp as it is.
    passing : ndarray of uint8, shape (h, w, 3), optional
        By `to_hsv`: what passes in front of a background that is known, in about its own colours; black elsewhere.
    """

    even: Image
    hsv: Image
    passing: Image | None = None

    @classmethod
    def of(cls, image: Image, background: Image | None = None) -> Picture:
        """Return the picture of an image in blue, green and red, uint8, shape (h, w, 3).

        `background` is that of a stationary camera, by `background_of`.
        """
        even = cv2.GaussianBlur(image, (0, 0), _BLUR_SIGMA)
        return cls(even, to_hsv(image), None if background is None else to_hsv(_brought_out(even, background)))


def background_of(images: Sequence[Image]) -> Image:
    """Return the background of a stationary camera, the median of some of its pictures, as `Picture.of` takes it."""
    return cv2.GaussianBlur(median_image(images), (0, 0), _BLUR_SIGMA)


def _brought_out(even: Image, background: Image) -> Image:
    """Return what passes in front of a background, in about its own colours.

    Where a small ball moves or the lens is soft, each pixel mixes the ball's colour with the background's, and is too
    pale to be recognised. The pixel's difference from the background points to the ball's colour: it is multiplied.
    """
    blue, green, red = cv2.split(cv2.absdiff(even, background))
    differs = cv2.max(cv2.max(blue, green), red)
    noise = NORMAL_MAD * float(np.median(differs))
    passes = differs > int(max(_MIN_CHANGE, _MIN_CHANGE_SIGMAS * noise))
    out = np.zeros_like(even)
    behind = LINEAR_LIGHT[background[passes]]
    light = behind + _UNMIXING_RATIO * (LINEAR_LIGHT[even[passes]] - behind)
    out[passes] = (255 * np.clip(light, 0, 1) ** (1 / GAMMA)).round()
    return out


def find_balls(picture: Picture, colour: Colour) -> Balls:
    """Return all balls of a colour in a picture, the largest first."""
    image, coloured = picture.even, colour.mask(picture.hsv)
    mask = cv2.morphologyEx(coloured, cv2.MORPH_OPEN, _SPECK_KERNEL)
    outlines, _ = cv2.findContours(mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    blobs = sorted(filter(_is_compact, outlines), key=len, reverse=True)[:_MAX_BLOBS]
    balls = Balls.joined([_ellipse_of(cv2.convexHull(blob)) for blob in blobs])
    balls = balls[2 * balls.semi_axes[:, 0] < _MAX_HEIGHT_SHARE * image.shape[0]]
    balls, good = refined_outlines(image, balls, np.zeros((len(balls), RAY_COUNT), bool), SEARCH_TOLERANCE)
    balls = balls[good & ~_is_small(balls)]
    masks = [coloured, colour.paler().mask(picture.hsv)]
    if picture.passing is not None:
        masks.append(colour.mask(picture.passing))
    small = find_small_balls(image, LIGHT, masks)
    return Balls.joined([balls, small[_is_small(small) & ~_within_others(small, balls)]])


def find_spots(picture: Picture, colour: Colour, most: int) -> Balls:
    """Return at most `most` small balls of a colour, the most conspicuous first, even in a room with that colour."""
    pure = colour.pure()
    if pure is None:
        return Balls.joined([])
    return coloured_spots(picture.even, LIGHT, colour.paler().mask(picture.hsv), pure, most=most)


def _is_small(balls: Balls) -> NDArray[np.bool_]:
    """Return which balls are measured by their colour's centroid: they are too small for an outline."""
    return np.asarray(balls.semi_axes[:, 1] < MAX_RADIUS)


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
    spokes = CIRCLE @ balls.shapes
    spokes /= np.linalg.norm(spokes, axis=-1, keepdims=True)
    hidden = (spokes @ np.swapaxes(ways, 1, 2) > _ROD_COSINE).any(axis=-1)
    measured, good = refined_outlines(
        picture.even, balls, hidden, MEASURING_TOLERANCE, CIRCLE_TERMS if still else ELLIPSE_TERMS
    )
    return balls.where(small, measured), small | good


def _small_without_rods(picture: Picture, balls: Balls, small: NDArray[np.bool_], ways: Array, *, still: bool) -> Balls:
    """Return the small balls measured without what rods hide, where enough is left of them."""
    if not small.any():
        return balls
    columns = [balls.centres.copy(), balls.shapes.copy(), balls.sigma.copy()]
    for k in np.flatnonzero(small):
        own = FoundBall(balls.centres[k], balls.shapes[k], float(balls.sigma[k]))
        measured = without_rod(picture.even, LIGHT, own, ways[k], still=still)
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
    return cv2.contourArea(outline) + edge >= max(_MIN_AREA, _MIN_SOLIDITY * (hull + edge))


def _ellipse_of(outline: Image) -> Balls:
    """Return the ellipse with the moments of what a contour encloses."""
    m = cv2.moments(outline)
    area = max(m["m00"], 1e-9)
    values, vectors = np.linalg.eigh(np.array([[m["mu20"], m["mu11"]], [m["mu11"], m["mu02"]]]) / area)
    half = 2 * np.sqrt(np.maximum(values, 0)) + 0.5
    return Balls(np.array([[m["m10"], m["m01"]]]) / area, ((vectors * half) @ vectors.T)[None], np.zeros(1))


def marked(image: Image, balls: Balls) -> Image:
    """Return a copy of a picture with a white and black ellipse round every ball."""
    shown = image.copy()
    for centre, shape in zip(balls.centres, balls.shapes, strict=True):
        for grow, colour in ((3.0, (0, 0, 0)), (2.0, (255, 255, 255))):
            ring = centre + CIRCLE @ (shape + grow * np.eye(2))
            cv2.polylines(shown, [(16 * ring).round().astype(np.int32)], True, colour, 1, cv2.LINE_AA, 4)
    return shown
