"""Outline evidence: where the performers end against the background.

Lines are laid across the outline of each part, every few pixels. The foreground image along a line gives a probability
for each of its positions that the body ends there; the mean is the measured position of the outline, and the variance
its uncertainty. The Jacobian row of such a measurement is the wrench of the outline's normal, so it can be summed like
those of the gradients. Outlines do not drift, because they compare a frame with the colours of the key frames and not
with the frame before. (Correspondence lines: M. Stoiber et al., SRT3D: A sparse region-based 3D object tracking
approach for the real world, IJCV 2022.)
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...cameras.camera import Camera
from ...numerics.arrays import Array
from ..foreground_images.foreground import log_ratio
from ..foreground_images.part_colours import ColouredFrames
from ..gradient_evidence.image_wrenches import wrenches
from ..rendering.label_images import LabelImages
from ..rendering.nearest_pixels import pixels_at
from ..smoothed_images import interpolated, stacked_places
from .outline_pieces import OutlinePieces, OutlineSamples, seen_pieces

CORRELATION_FACTOR = 0.5
"""Factor on log likelihood ratios along a line, as neighbouring pixels are correlated."""
MODEL_SIGMA = 0.012
"""Standard deviation of the performer's outline from that of the rigid model, metres."""
EDGE_SIGMA = 1.0
"""Standard deviation of an edge in the foreground image from the body's, pixels."""
BISQUARE_LIMIT = 4.0
"""Residual in standard deviations from which on a line has no influence (Tukey's bisquare)."""
KEY_FRAME_PIECE = 0.25
"""Length of outline that counts as one measurement where the shape of the model is fitted to key frames, metres. It is
longer than in tracking, as the model is wrong in the same way on the few frames."""
_MAX_EDGE_SHARE = 0.75  # share of a line's half length: an edge found beyond is the line's end


@dataclass(frozen=True)
class LineSearch:
    """How outlines are searched for along lines across the model's.

    Attributes
    ----------
    stride : int
        Distance between the pixels of the label images, in rows and in columns.
    reach : int
        Half the length of the lines, pixels.
    tolerance : float
        Factor on the limit of the robust weights: 1 near the solution, larger far from it.
    """

    stride: int
    reach: int
    tolerance: float

    @property
    def places(self) -> NDArray[np.int_]:
        """The L positions along a line, pixels outward from the model's outline."""
        return np.arange(-self.reach, self.reach + 1)


@dataclass(frozen=True, eq=False)
class Lines(OutlineSamples):
    """N lines across outlines; each stands for a length in metres.

    Attributes
    ----------
    points_cam : ndarray, shape (N, 3)
        Points of the parts at these positions, in camera axes, metres.
    shift : ndarray, shape (N,)
        Measured distance of the body's outline along the normal, pixels.
    weight : ndarray, shape (N,)
        Inverse variance of the shift times its robust weight, pixels^-2.
    error : ndarray, shape (N,)
        Robust error (Tukey) of the shift, in variances.
    """

    points_cam: Array
    shift: Array
    weight: Array
    error: Array

    def wrenches(self, camera: Camera) -> Array:
        """Derivatives of the positions along the normals by twists in camera axes, shape (N, 6)."""
        focal = camera.matrix[[0, 1], [0, 1]].astype(np.float32)
        return wrenches(self.points_cam.astype(np.float32), self.normal.T.astype(np.float32), focal).astype(float)

    def cost(self, camera: Camera, points_cam: Array) -> float:
        """Return the weighted sum of squares of the shifts that remain once the points have moved to points_cam (N,
        3).
        """
        z = points_cam[:, 2:]
        if (z <= 0).any():
            return float("inf")
        uv = points_cam[:, :2] / z * camera.matrix[[0, 1], [0, 1]] + camera.matrix[:2, 2]
        left = self.shift - ((uv - self.uv) * self.normal).sum(axis=1)
        return float((self.weight * self.length) @ left**2)

    def products(self, rows: Array, n: int, P: int) -> Array:
        """Weighted sums of the products of the lines' rows (N, k) with themselves, per frame and part, (n, P, k, k)."""
        columns, k = np.ascontiguousarray(rows.T), rows.shape[1]
        count = np.bincount(self.frame * P + self.part, minlength=n * P)
        there = np.flatnonzero(count)
        i, j = np.triu_indices(k)
        sums = np.zeros((n * P, k, k))
        if len(there):
            # A part has few lines: one pass for each two columns is faster than a product of matrices for each part.
            each = (columns * (self.weight * self.length))[i]
            each *= columns[j]
            sums[there[:, None], i, j] = np.add.reduceat(each, (np.cumsum(count) - count)[there], axis=1).T
            sums[there[:, None], j, i] = sums[there[:, None], i, j]
        return sums.reshape(n, P, k, k)


def outline_lines(
    camera: Camera,
    foreground: NDArray[np.uint8],
    labels: LabelImages,
    search: LineSearch,
    *,
    halo: float = 0.0,
    coloured: ColouredFrames | None = None,
) -> Lines:
    """Measure the body's outline along lines across the model's.

    Parameters
    ----------
    camera : Camera
        The view's camera, for its reduced and rectified frames.
    foreground : ndarray of uint8, shape (M, n, h, w)
        Foreground images of each performer, see `core.evidence.foreground_images.foreground`.
    labels : LabelImages
        Label images of the n frames, with every stride-th pixel.
    search : LineSearch
    halo : float
        Distance by which foreground images extend beyond the body's edge, pixels.
    coloured : ColouredFrames, optional
        Colours of the parts; with them, outlines of parts in front of other parts of the same performer are measured,
        too.
    """
    pieces = seen_pieces(labels, search.stride, None if coloured is None else coloured.colours.distinct)
    places = search.places
    # In double precision, as exponentials in single precision differ between processors.
    ratio = np.zeros((len(places), len(pieces.uv)))
    own = pieces.behind >= 0
    ratio[:, ~own] = _ratios_along(foreground, labels, pieces.where(~own), search).T
    if coloured is not None:
        ratio[:, own] = _colour_ratios_along(coloured, labels, pieces.where(own), search).T
    mean, spread = _edge_positions(ratio, places)
    shift, variance = mean - np.where(own, 0.0, halo), spread + EDGE_SIGMA**2
    ignorance = len(places) ** 2 / 12 + EDGE_SIGMA**2  # of a line along which nothing is seen
    information = np.maximum(1 / variance - 1 / ignorance, 0)
    focal = camera.matrix[[0, 1], [0, 1]]
    z = pieces.depth
    model = (MODEL_SIGMA * focal.mean() / z) ** 2
    farthest = BISQUARE_LIMIT * search.tolerance * np.sqrt(model + EDGE_SIGMA**2)
    farthest = np.minimum(farthest, _MAX_EDGE_SHARE * search.reach)
    robust = np.maximum(1 - (shift / farthest) ** 2, 0)
    precision = information / (1 + information * model)
    points = np.concatenate([(pieces.uv - camera.matrix[:2, 2]) / focal * z[:, None], z[:, None]], axis=1)
    return Lines(
        frame=pieces.frame,
        part=pieces.part,
        uv=pieces.uv,
        normal=pieces.normal,
        length=pieces.length * z / focal.mean(),
        points_cam=points,
        shift=shift,
        weight=robust**2 * precision,
        error=farthest**2 / 3 * (1 - robust**3) * precision,
    )


def _edge_positions(ratio: Array, places: NDArray[np.int_]) -> tuple[Array, Array]:
    """Return the means and variances (N,) of where the body ends along lines, by log likelihood ratios (L, N) at their
    L places.
    """
    score = np.cumsum(ratio, axis=0)
    score -= score[-1] / 2  # of an end between a place and the next: inside less outside
    score -= score.max(axis=0, initial=-np.inf)
    score *= 2 * CORRELATION_FACTOR
    likely = np.exp(score, out=score)
    end = places + 0.5
    total, first, second = np.stack([np.ones(len(end)), end, end**2]) @ likely
    return first / total, second / total - (first / total) ** 2


def _colour_ratios_along(
    coloured: ColouredFrames,
    labels: LabelImages,
    pieces: OutlinePieces,
    search: LineSearch,
) -> Array:
    """Log likelihood ratios (part against the part behind it) of the colours along lines, shape (N, L).

    They are 0 where the model predicts something else, as in `_ratios_along`.
    """
    ratio, distinct = coloured.colours.ratio, coloured.colours.distinct
    places, stride = search.places, search.stride
    u, v = (pieces.uv[:, k, None] + pieces.normal[:, k, None] * places for k in range(2))
    frame, part = pieces.frame[:, None], pieces.part[:, None]
    colour = pixels_at(coloured.palette, frame, u, v, np.uint8(0))
    label = labels.part_at(frame, u / stride, v / stride).astype(np.intp)
    near = np.abs(places) <= stride
    other = (label >= 0) & distinct[part, label]
    predicted = np.where(places > 0, other, label == part) | near
    behind = np.where((places > 0) & other, label, pieces.behind[:, None])
    return np.where(predicted & (label != -2), ratio[part, colour] - ratio[behind, colour], np.float32(0))


def _ratios_along(
    foreground: NDArray[np.uint8], labels: LabelImages, pieces: OutlinePieces, search: LineSearch
) -> Array:
    """Log likelihood ratios along the lines, shape (N, L).

    They are 0 where the model predicts something else: another part beyond the outline, or background within.
    """
    places, stride = search.places, search.stride
    frame, across = pieces.frame, places.astype(np.float32)
    place, outward = pieces.uv.astype(np.float32), pieces.normal.astype(np.float32)
    u, v = (place[:, k, None] + outward[:, k, None] * across for k in range(2))
    _, n, height, width = foreground.shape
    performer = labels.performer[pieces.part]
    seen = np.empty(u.shape, np.uint8)
    for own, images in enumerate(foreground):
        rows = np.flatnonzero(performer == own)
        at = stacked_places(u[rows], v[rows], frame[rows, None], height)
        seen[rows] = interpolated(images.reshape(n * height, width), at, (len(rows), len(places)))
    label = labels.part_at(frame[:, None], u / np.float32(stride), v / np.float32(stride))
    predicted = (label == -1) == (places > 0)
    predicted |= np.abs(places) <= stride
    return np.where(predicted & (label != -2), log_ratio(seen), 0.0)
