"""Outline evidence: where the performers end against the background.

Lines are laid across the outline of each part, every few pixels. The foreground image along a line gives a probability
for each of its positions that the body ends there; the mean is the measured position of the outline, and the variance
its uncertainty. The Jacobian row of such a measurement is the wrench of the outline's normal, so it can be summed like
those of the gradients. Outlines do not drift, because they compare a frame with the colours of the key frames and not
with the frame before. (Correspondence lines: M. Stoiber et al., SRT3D: A sparse region-based 3D object tracking
approach for the real world, IJCV 2022.)
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from ..cameras.camera import Camera
from ..numerics.arrays import Array, Bools
from .foreground import log_ratio
from .image_wrenches import camera_twist, wrenches
from .label_images import LabelImages, pixels_at
from .part_colours import ColouredFrames
from .view_frames import interpolated, stacked_places

Indices = NDArray[np.intp]

SPACING = 1.5
"""Distance between lines along an outline, in strides of pixels."""
CONTRAST = 0.5
"""Factor on log likelihood ratios along a line, as neighbouring pixels are correlated."""
MODEL_DEVIATION = 0.012
"""Standard deviation of the performer's outline from that of the rigid model, metres."""
EDGE_DEVIATION = 1.0
"""Standard deviation of an edge in the foreground image from the body's, pixels."""
BISQUARE = 4.0
"""Residual in standard deviations from which on a line has no influence (Tukey's bisquare)."""
KEY_PIECE = 0.25
"""Length of outline that counts as one measurement where the shape of the model is fitted to key frames, metres. It is
longer than in tracking, as the model is wrong in the same way on the few frames."""
_FARTHEST = 0.75  # share of a line's half length: an edge found beyond is the line's end


@dataclass(frozen=True, eq=False)
class Lines:
    """N lines across the outlines of the parts in n frames, sorted by frame and part.

    Attributes
    ----------
    frame, part : ndarray of int, shape (N,)
    uv : ndarray, shape (N, 2)
        Positions on the model's outlines, pixels of the view's frames.
    normal : ndarray, shape (N, 2)
        Unit normals of the outlines, pointing outward.
    points_cam : ndarray, shape (N, 3)
        Points of the parts at these positions, in camera axes, metres.
    length : ndarray, shape (N,)
        Length of outline that each line stands for, metres.
    shift : ndarray, shape (N,)
        Measured distance of the body's outline along the normal, pixels.
    weight : ndarray, shape (N,)
        Inverse variance of the shift times its robust weight, pixels^-2.
    error : ndarray, shape (N,)
        Robust error (Tukey) of the shift, in variances.
    """

    frame: Indices
    part: Indices
    uv: Array
    normal: Array
    points_cam: Array
    length: Array
    shift: Array
    weight: Array
    error: Array

    def where(self, kept: Bools) -> Lines:
        """Return some of the lines."""
        return Lines(**{item.name: getattr(self, item.name)[kept] for item in fields(self)})

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


@dataclass(frozen=True, eq=False)
class OutlineSums:
    """Normal equations of the twists of P parts in n frames.

    Attributes
    ----------
    H : ndarray, shape (n, P, 6, 6)
        Sums of products of wrenches about the world's origin per metre of outline.
    g : ndarray, shape (n, P, 6)
        Gradient of half the energy.
    energy : ndarray, shape (n,)
        Robust sum of the squared shifts (Tukey's error).
    """

    H: Array
    g: Array
    energy: Array


def outline_sums(
    camera: Camera,
    foreground: NDArray[np.uint8],
    labels: LabelImages,
    *,
    first: int,
    stride: int,
    reach: int,
    tolerance: float,
    halo: float = 0.0,
    coloured: ColouredFrames | None = None,
) -> OutlineSums:
    """Sum the outline evidence of n frames of one view.

    `first` is the shot frame of the first of them; the other parameters are those of `outline_lines`.
    """
    lines = outline_lines(
        camera, foreground, labels, stride=stride, reach=reach, tolerance=tolerance, halo=halo, coloured=coloured
    )
    n, P = labels.share.shape
    sums = lines.products(np.concatenate([lines.wrenches(camera), -lines.shift[:, None]], axis=1), n, P)
    A = camera_twist(*camera.poses(first, n))[:, None]
    A_t = np.swapaxes(A, -1, -2)
    energy = np.bincount(lines.frame, lines.error * lines.length, minlength=n).astype(float)
    return OutlineSums(A_t @ sums[..., :6, :6] @ A, (A_t @ sums[..., :6, 6:])[..., 0], energy)


def outline_lines(
    camera: Camera,
    foreground: NDArray[np.uint8],
    labels: LabelImages,
    *,
    stride: int,
    reach: int,
    tolerance: float,
    halo: float = 0.0,
    coloured: ColouredFrames | None = None,
) -> Lines:
    """Measure the body's outline along lines across the model's.

    Parameters
    ----------
    camera : Camera
        The view's camera, for its reduced and rectified frames.
    foreground : ndarray of uint8, shape (M, n, h, w)
        Foreground images of each performer, see `core.evidence.foreground`.
    labels : LabelImages
        Label images of the n frames, with every stride-th pixel.
    stride : int
        Distance between the pixels of the label images, in rows and in columns.
    reach : int
        Half the length of the lines, pixels.
    tolerance : float
        Factor on the limit of the robust weights: 1 near the solution, larger far from it.
    halo : float
        Distance by which foreground images extend beyond the body's edge, pixels.
    coloured : ColouredFrames, optional
        Colours of the parts; with them, outlines of parts in front of other parts of the same performer are measured,
        too.
    """
    pieces = _seen_pieces(labels, stride, None if coloured is None else coloured.colours.distinct)
    places = np.arange(-reach, reach + 1)
    # In double precision, as exponentials in single precision differ between processors.
    ratio = np.zeros((len(pieces.uv), len(places)))
    own = pieces.behind >= 0
    ratio[~own] = _along(foreground, labels, pieces.where(~own), places, stride)
    if coloured is not None:
        ratio[own] = _along_within(coloured, labels, pieces.where(own), places, stride)
    inside = np.cumsum(ratio, axis=1)
    score = CONTRAST * (2 * inside - inside[:, -1:])  # of an end between a place and the next: inside less outside
    likely = np.exp(score - score.max(axis=1, keepdims=True, initial=-np.inf))
    likely /= likely.sum(axis=1, keepdims=True)
    ends = places + 0.5 - np.where(own, 0.0, halo)[:, None]
    shift = (likely * ends).sum(axis=1)
    variance = (likely * (ends - shift[:, None]) ** 2).sum(axis=1) + EDGE_DEVIATION**2
    ignorance = len(places) ** 2 / 12 + EDGE_DEVIATION**2  # of a line along which nothing is seen
    information = np.maximum(1 / variance - 1 / ignorance, 0)
    focal = camera.matrix[[0, 1], [0, 1]]
    z = pieces.depth
    model = (MODEL_DEVIATION * focal.mean() / z) ** 2
    farthest = np.minimum(BISQUARE * tolerance * np.sqrt(model + EDGE_DEVIATION**2), _FARTHEST * reach)
    robust = np.maximum(1 - (shift / farthest) ** 2, 0)
    precision = information / (1 + information * model)
    points = np.concatenate([(pieces.uv - camera.matrix[:2, 2]) / focal * z[:, None], z[:, None]], axis=1)
    return Lines(
        pieces.frame,
        pieces.part,
        pieces.uv,
        pieces.normal,
        points,
        pieces.length * z / focal.mean(),
        shift,
        weight=robust**2 * precision,
        error=farthest**2 / 3 * (1 - robust**3) * precision,
    )


@dataclass(frozen=True, eq=False)
class _Pieces:
    """N visible pieces of the parts' outlines.

    `uv` (N, 2) are their midpoints and `length` (N,) their lengths, pixels; `normal` (N, 2) points outward, and `depth`
    (N,) is the distance along the camera's axis, metres. `behind` (N,) is the part that is seen just outside, or -1 for
    the background.
    """

    frame: Indices
    part: Indices
    uv: Array
    normal: Array
    depth: Array
    length: Array
    behind: Indices

    def where(self, kept: Bools) -> _Pieces:
        """Some of the pieces."""
        return _Pieces(**{item.name: getattr(self, item.name)[kept] for item in fields(self)})


def _seen_pieces(labels: LabelImages, stride: int, distinct: Bools | None) -> _Pieces:
    """Find the pieces of outline with their part on the inner side and, on the outer one, the background or a part
    behind it that has distinct colours.
    """
    outlines, after = labels.outlines, labels.outlines.following
    group = outlines.group
    a, z_a = stride * outlines.uv, outlines.depth
    step, z_b = a[after] - a, z_a[after]
    length = np.hypot(*step.T)
    spacing = SPACING * stride
    pieces = np.where(length > 0.1 * spacing, np.ceil(length / spacing), 0).astype(np.intp)
    edge = np.repeat(np.arange(len(a)), pieces)
    t = (np.arange(len(edge)) - np.repeat(np.cumsum(pieces) - pieces, pieces) + 0.5) / pieces[edge]
    along = step[edge]
    uv, z = a[edge] + along * t[:, None], 1 / ((1 - t) / z_a[edge] + t / z_b[edge])
    # Outlines go clockwise as the picture is seen: outward lies to the left.
    normal = np.stack([along[:, 1], -along[:, 0]], axis=1) / length[edge, None]
    frame, part = np.divmod(group[edge], labels.share.shape[1])
    each = (length / np.maximum(pieces, 1))[edge]
    kept = np.flatnonzero(labels.part_at(frame, *(uv - 0.75 * stride * normal).T / stride) == part)
    frame, part, uv, normal, z, each = (values[kept] for values in (frame, part, uv, normal, z, each))
    beyond = labels.part_at(frame, *(uv + stride * normal).T / stride).astype(np.intp)
    seen = beyond == -1
    if distinct is not None:
        nearness = np.argsort(labels.far_to_near, axis=1)
        others = np.flatnonzero(beyond >= 0)
        f, own, other = frame[others], part[others], beyond[others]
        seen[others] = distinct[own, other] & (nearness[f, own] > nearness[f, other])
    return _Pieces(frame, part, uv, normal, z, each, beyond).where(seen)


def _along_within(
    coloured: ColouredFrames,
    labels: LabelImages,
    pieces: _Pieces,
    places: NDArray[np.int_],
    stride: int,
) -> Array:
    """Log likelihood ratios (part against the part behind it) of the colours along lines, shape (N, len(places)).

    They are 0 where the model predicts something else, as in `_along`.
    """
    ratio, distinct = coloured.colours.ratio, coloured.colours.distinct
    u, v = (pieces.uv[:, k, None] + pieces.normal[:, k, None] * places for k in range(2))
    frame, part = pieces.frame[:, None], pieces.part[:, None]
    colour = pixels_at(coloured.palette, frame, u, v, np.uint8(0))
    label = labels.part_at(frame, u / stride, v / stride).astype(np.intp)
    near = np.abs(places) <= stride
    other = (label >= 0) & distinct[part, label]
    predicted = np.where(places > 0, other, label == part) | near
    behind = np.where((places > 0) & other, label, pieces.behind[:, None])
    return np.where(predicted & (label != -2), ratio[part, colour] - ratio[behind, colour], np.float32(0))


def _along(
    foreground: NDArray[np.uint8], labels: LabelImages, pieces: _Pieces, places: NDArray[np.int_], stride: int
) -> Array:
    """Log likelihood ratios along the lines, shape (N, len(places)).

    They are 0 where the model predicts something else: another part beyond the outline, or background within.
    """
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
