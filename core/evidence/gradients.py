"""Spatio-temporal gradient evidence by wrench accumulation (paper 1, equations (8) to (12)).

A pixel that shows a part in frame a is a fixed point of that part and looks the same in frame b (brightness
constancy). With m = (dE/du)(du/dx), the derivative of the brightness by the point, the pixel's row against the part's
twist is its wrench (m, x cross m). Products of wrenches are summed per part, twelve by twelve (six for frame a, six
for frame b), so the cost per pixel does not depend on the number of joints, and cameras simply add.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..body.kinematics import Poses
from ..cameras.camera import Camera
from ..numerics import rotations
from ..numerics.arrays import Array
from ..numerics.robust_kernels import NORMAL_MAD
from .foreground import log_ratio
from .label_images import LabelImages
from .view_frames import GradientImages, Image

HUBER = 1.345
"""Limit of Huber's loss between its quadratic and linear parts, standard deviations (95 % efficiency for normal
noise)."""
BACKGROUND_BELOW = -0.5
"""Log likelihood ratio below which a pixel within the model's outline counts as background."""
OUTLIERS = 0.05
"""Fraction of pixels whose brightness changes arbitrarily, because of occlusion or shading."""
PART_PIXELS = 20.0
"""A part's own noise is drawn toward that of its pair of frames, and its change of brightness toward none, as by so
many pixels."""
_LEAST_NOISE = 2e-4
_LEAST_DEVIATION = 1e-3  # of the residuals of a frame whose pixels show next to nothing
_AT_A_TIME = 16  # groups of pixels, few enough to stay in the processor's cache


@dataclass(frozen=True, eq=False)
class GradientSums:
    """Normal equations of the twists of P parts in m pairs of frames.

    Attributes
    ----------
    H : ndarray, shape (m, P, 12, 12)
        Weighted sums of products of wrenches about the world's origin, the earlier frame's six before the later's.
    g : ndarray, shape (m, P, 12)
        Weighted sums of wrenches times residuals: the gradient of half the energy.
    energy : ndarray, shape (m,)
        Weighted sum of squared residuals, (grey level 0 to 1)^2.
    weight : ndarray, shape (m,)
        Sum of the weights.
    noise : ndarray, shape (m, 1 + P)
        Robust standard deviation of the residuals of each pair of frames, and of each of its parts, grey level 0 to 1.
    density : ndarray, shape (m,)
        Mean number of the view's pixels per square metre facing it; 0 if no part is seen.
    count : ndarray, shape (m,)
        Number of pixels used.
    cost : ndarray, shape (m,)
        Mean of Huber's loss of these pixels with a given noise, (grey level 0 to 1)^2.
    gain : ndarray, shape (m,)
        How much likelier these pixels are than if what they show stood still in the picture, in natural units, under
        the noise of their pair of frames. Where one of several performers is solved, that of the others, whom it may
        hide, is added (`core.evidence.segment_evidence`).
    """

    H: Array
    g: Array
    energy: Array
    weight: Array
    noise: Array
    density: Array
    count: Array
    cost: Array
    gain: Array


@dataclass(frozen=True, eq=False)
class Pixels:
    """The pixels of n label images that show a part.

    Attributes
    ----------
    frame, part : ndarray of int, shape (N,)
    ends : ndarray of int
        See `LabelImages`.
    uv : ndarray of int, shape (N, 2)
        Their positions in the view's frames, pixels.
    points_cam : ndarray of float32, shape (N, 3)
        The points that they show, in camera axes, metres.
    """

    frame: NDArray[np.intp]
    part: NDArray[np.intp]
    ends: NDArray[np.intp]
    uv: NDArray[np.intp]
    points_cam: Image

    @classmethod
    def of(cls, labels: LabelImages, camera: Camera, stride: int, frames: int) -> Pixels:
        """Return the pixels of the first `frames` label images, which have every stride-th pixel of the camera's
        frames.
        """
        P = labels.share.shape[1]
        ends = labels.ends[: frames * P + 1]
        frame, u, v = (a[: ends[-1]] for a in labels.places)
        part = np.repeat(np.tile(np.arange(P), frames), np.diff(ends))
        uv = stride * np.stack([u, v])
        K = camera.matrix.astype(np.float32)
        points = np.empty((3, ends[-1]), np.float32)
        points[2] = 1 / labels.inverse_depth[: ends[-1]]
        points[:2] = (uv.astype(np.float32) - K[:2, 2:]) / K[[0, 1], [0, 1]][:, None] * points[2]
        return cls(frame, part, ends, uv.T, points.T)


@dataclass(frozen=True, eq=False)
class LabelledFrames:
    """n consecutive frames of one view, with the label images of some poses.

    Attributes
    ----------
    camera : Camera
        The view's camera, for its reduced and rectified frames.
    images : GradientImages
        Brightness and derivatives of the frames.
    labels : LabelImages
        Label images of the frames, with every stride-th pixel.
    poses : tuple
        World poses (R, T) of all parts, (n, P, 3, 3) and (n, P, 3).
    first : int
        Shot frame of the first of them.
    stride : int
        Step between the pixels of the label images, in both directions.
    foreground : ndarray of uint8, shape (M, n, h, w), optional
        Foreground images of each performer, by which pixels that show something else are left out; see
        `core.evidence.foreground`.
    """

    camera: Camera
    images: GradientImages
    labels: LabelImages
    poses: Poses
    first: int
    stride: int
    foreground: NDArray[np.uint8] | None = None


def brightness_constancy(
    frames: LabelledFrames, tolerance: float, given_noise: Array | None = None, *, by_part: bool = False
) -> GradientSums:
    """Sum the brightness constancy constraint between neighbouring frames of one view.

    A pixel of a frame is used if its point is still visible on the next frame.

    Parameters
    ----------
    frames : LabelledFrames
        n frames.
    tolerance : float
        Huber's limit in units of `HUBER` standard deviations: 1 near the solution, more far from it.
    given_noise : ndarray, shape (n - 1, 1 + P), optional
        The noise under which the cost is measured, see `GradientSums`; by default their own.
    by_part : bool
        Whether every part has a noise of its own, and may get brighter or darker as a whole.

    Returns
    -------
    GradientSums
        For the m = n - 1 pairs of neighbouring frames.
    """
    camera, labels = frames.camera, frames.labels
    m, P = len(frames.poses[0]) - 1, labels.share.shape[1]
    to_camera = camera.poses(frames.first, m + 1)
    compared = _compared(frames)
    pixels, residual, seen = compared.pixels, compared.residual, compared.seen
    x_a, x_b = pixels.points_cam, compared.points_there
    focal = camera.matrix[[0, 1], [0, 1]].astype(np.float32)
    here, there = compared.here, compared.there
    slope = 0.5 * (here[1:] + there[1:])
    changes, noise = _residuals_of_parts(residual, seen, pixels.ends, P, by_part=by_part)
    change = np.repeat(changes.ravel(), np.diff(pixels.ends)).astype(np.float32)
    weight = _weights(residual - change, noise, tolerance, pixels.ends) * seen
    given = noise if given_noise is None else given_noise
    given = given if by_part else np.repeat(given[:, :1], 1 + P, axis=1)
    deviation, relative = _deviations(given, tolerance, pixels.ends)
    error = relative * huber_errors(residual - change, deviation)
    count = np.bincount(pixels.frame, seen, minlength=m).astype(float)
    error_sum = np.bincount(pixels.frame, error * seen, minlength=m).astype(float)
    error_sum += PART_PIXELS * ((given[:, :1] / given[:, 1:]) ** 2 * changes**2).sum(axis=1)
    gain = _gains(compared, frames.images, (tolerance * given[pixels.frame, 0]).astype(np.float32))

    rows = np.empty((13, len(residual)), np.float32)
    rows[:6], rows[6:12], rows[12] = -wrenches(x_a, slope, focal).T, wrenches(x_b, slope, focal).T, residual
    if by_part:
        rows = np.concatenate([rows, np.ones((1, len(residual)), np.float32)])
    sums = summed_products(rows, weight, pixels.ends).reshape(m, P, len(rows), len(rows))
    if by_part:
        sums = _without_change(sums, PART_PIXELS * (noise[:, :1] / noise[:, 1:]) ** 2)
    A = _pair_twists(*to_camera)[:, None]
    A_t = np.swapaxes(A, -1, -2)
    return GradientSums(
        A_t @ sums[..., :12, :12] @ A,
        (A_t @ sums[..., :12, 12:])[..., 0],
        sums[..., 12, 12].sum(axis=1),
        np.bincount(pixels.frame, weight, minlength=m).astype(float),
        noise,
        np.prod(focal)
        * np.bincount(pixels.frame, labels.inverse_depth[: len(residual)] ** 2, minlength=m)
        / np.maximum(np.diff(pixels.ends[::P]), 1),
        count,
        error_sum / np.maximum(count, 1),
        np.bincount(pixels.frame, gain, minlength=m).astype(float),
    )


@dataclass(frozen=True, eq=False)
class PixelGains:
    """Contributions to `GradientSums.gain` of the pixels of parts that stay in place, while others move in front of
    them.

    Attributes
    ----------
    here, there : ndarray of int, shape (N,)
        Indices of the pixels, and of their points one frame later, among all pixels of the n label images.
    frame, part : ndarray of int, shape (N,)
    gain : ndarray, shape (N,)
    """

    here: NDArray[np.intp]
    there: NDArray[np.intp]
    frame: NDArray[np.intp]
    part: NDArray[np.intp]
    gain: NDArray[np.floating[Any]]

    @classmethod
    def of(
        cls,
        frames: LabelledFrames,
        tolerance: float,
        noise: Array,
    ) -> PixelGains:
        """Return the gains of the parts in label images; parameters as in `brightness_constancy`."""
        compared, labels = _compared(frames), frames.labels
        pixels, deviation = compared.pixels, tolerance * np.maximum(noise, _LEAST_NOISE)
        gain = _gains(compared, frames.images, deviation[pixels.frame, 0])
        kept = np.flatnonzero(compared.seen)
        _, height, width = labels.part.shape
        u, v = np.rint(compared.uv_there[kept].T / frames.stride).astype(np.intp)
        frame = pixels.frame[kept]
        there = ((frame + 1) * height + v) * width + u
        return cls(labels.index[: len(gain)][kept], there, frame, pixels.part[kept], gain[kept])

    def visible(self, part: NDArray[np.int16], numbers: NDArray[np.intp], pairs: int) -> Array:
        """Return the sums (m,) over the pixels that are visible on both frames in label images of all parts (n, h, w);
        `numbers` are the indices of these parts among all.
        """
        own, shown = numbers.astype(np.int16).take(self.part), part.ravel()
        hidden = shown.take(self.here) != own
        hidden |= shown.take(self.there) != own
        lost = np.flatnonzero(hidden)
        return self._sums(slice(None), pairs) - self._sums(lost, pairs)

    def _sums(self, of: slice | NDArray[np.intp], pairs: int) -> Array:
        return np.bincount(self.frame[of], self.gain[of], minlength=pairs).astype(float)


@dataclass(frozen=True, eq=False)
class _Compared:
    """Pixels that show parts, and their points on the next frame, in camera axes (N, 3) and in the picture (N, 2), with
    brightness and its derivatives (3, N) on both frames, the difference of brightness, and which pixels are used.
    """

    pixels: Pixels
    points_there: Image
    uv_there: Image
    here: Image
    there: Image
    residual: Image
    seen: NDArray[np.bool_]


def _compared(frames: LabelledFrames) -> _Compared:
    camera, images, labels, poses = frames.camera, frames.images, frames.labels, frames.poses
    m = len(poses[0]) - 1
    pixels = Pixels.of(labels, camera, frames.stride, m)
    x_b = _carried(pixels, camera.poses(frames.first, m + 1), poses)
    focal, centre = (a.astype(np.float32) for a in (camera.matrix[[0, 1], [0, 1]], camera.matrix[:2, 2]))
    uv_b = (x_b.T[:2] / x_b[:, 2] * focal[:, None] + centre[:, None]).T
    here, there = images.at(pixels.frame, pixels.uv), images.sample(pixels.frame + 1, uv_b)
    seen = labels.part_at(pixels.frame + 1, *(uv_b.T / frames.stride)) == pixels.part
    if frames.foreground is not None:
        whose = labels.performer[pixels.part]
        seen &= log_ratio(frames.foreground[whose, pixels.frame, pixels.uv[:, 1], pixels.uv[:, 0]]) > BACKGROUND_BELOW
    return _Compared(pixels, x_b, uv_b, here, there, there[0] - here[0], seen)


def _gains(compared: _Compared, images: GradientImages, deviation: NDArray[np.floating[Any]]) -> Array:
    """Return how much likelier each pixel is than if its point stood still, natural units, (N,); 0 for unused ones."""
    pixels, deviation = compared.pixels, np.maximum(deviation, _LEAST_DEVIATION)
    still = images.at(pixels.frame + 1, pixels.uv)[0] - compared.here[0]
    moved, stood = (log_likelihoods(residual, deviation) for residual in (compared.residual, still))
    return np.asarray((moved - stood) * compared.seen)


def log_likelihoods(residual: NDArray[np.floating[Any]], deviation: NDArray[np.floating[Any]]) -> Array:
    """Return the log likelihoods of residuals, up to a constant: normal, or with probability `OUTLIERS` uniform.

    No single pixel can then cost more than an outlier. With Huber's loss, a pixel on an edge counts as much as eighty
    that are off by one standard deviation, and a few such pixels outweigh all else.
    """
    outliers = OUTLIERS / (1 - OUTLIERS) * np.sqrt(2 * np.pi) * deviation.astype(float)
    return np.asarray(np.log(np.exp(-0.5 * (residual.astype(float) / deviation) ** 2) + outliers))


def _carried(pixels: Pixels, to_camera: Poses, poses: Poses) -> Image:
    """Return the pixels' points moved with their parts to the next frame, in its camera's axes, shape (N, 3)."""
    (Rc, tc), (R, T) = to_camera, poses
    R_cam, T_cam = Rc[:, None] @ R, T @ np.swapaxes(Rc, 1, 2) + tc[:, None]
    turn = R_cam[1:] @ np.swapaxes(R_cam[:-1], -1, -2)
    shift = T_cam[1:] - (turn @ T_cam[:-1, :, :, None])[..., 0]
    # In double precision: the last bit of a single-precision product depends on the alignment of arrays.
    rows = np.concatenate([turn, shift[..., None]], axis=-1).reshape(-1, 12).T
    move = np.repeat(np.ascontiguousarray(rows), np.diff(pixels.ends), axis=1)
    x, y, z = pixels.points_cam.T.astype(float)
    out = np.empty((3, len(x)), np.float32)
    for row, (a, b, c, d) in zip(out, move.reshape(3, 4, -1), strict=True):
        a *= x
        b *= y
        c *= z
        a += b
        a += c
        a += d
        row[:] = a
    return out.T


def summed_products(
    rows: NDArray[np.floating[Any]], weight: NDArray[np.floating[Any]], ends: NDArray[np.intp]
) -> Array:
    """Return weighted sums of the products of columns (k, N) with themselves, over columns ends[i] to ends[i + 1].

    The shape is (len(ends) - 1, k, k). Sums in single precision might not be positive definite.
    """
    sums = np.zeros((len(ends) - 1, len(rows), len(rows)))
    for first in range(0, len(sums), _AT_A_TIME):
        bounds = ends[first : first + _AT_A_TIME + 1]
        some = rows[:, bounds[0] : bounds[-1]].astype(float)
        weighted = (some * weight[bounds[0] : bounds[-1]]).T
        for i, (a, b) in enumerate(pairwise((bounds - bounds[0]).tolist()), first):
            if a < b:
                sums[i] = some[:, a:b] @ weighted[a:b]
    return sums


def _residuals_of_parts(
    residual: Image, seen: NDArray[np.bool_], ends: NDArray[np.intp], parts: int, *, by_part: bool
) -> tuple[Array, Array]:
    """Return by how much each part gets brighter (m, P), and the noise, see `GradientSums`; without `by_part` nothing
    gets brighter, and all parts have the noise of their pair of frames.
    """
    of_pairs = [_robust_deviation(residual[a:b][seen[a:b]]) for a, b in pairwise(ends[::parts])]
    noise = np.repeat(np.maximum(of_pairs, _LEAST_NOISE)[:, None], 1 + parts, axis=1)
    change = np.zeros((len(of_pairs), parts))
    if by_part:
        own, count = residual[seen], np.diff(np.concatenate([[0], np.cumsum(seen)])[ends])
        share = count / (count + PART_PIXELS)
        brighter = share * _medians(own, count)
        apart = _medians(np.abs(own - np.repeat(brighter.astype(np.float32), count)), count)
        own_noise = np.sqrt(share * (NORMAL_MAD * apart) ** 2 + (1 - share) * np.repeat(noise[:, 0], parts) ** 2)
        change = brighter.reshape(change.shape)
        noise[:, 1:] = np.where(count > 0, own_noise, noise[:, 1:].ravel()).reshape(change.shape)
    return change, np.maximum(noise, _LEAST_NOISE)


def _deviations(noise: Array, tolerance: float, ends: NDArray[np.intp]) -> tuple[Image, Image]:
    """Return the standard deviation of each pixel, and its inverse variance relative to that of its pair of frames."""
    each = np.repeat(noise[:, 1:].ravel(), np.diff(ends))
    relative = np.repeat((noise[:, :1] / noise[:, 1:]).ravel() ** 2, np.diff(ends))
    return (tolerance * each).astype(np.float32), relative.astype(np.float32)


def _weights(residual: Image, noise: Array, tolerance: float, ends: NDArray[np.intp]) -> Image:
    """Return the weights of pixels: Huber's, times the relative inverse variance of their part."""
    deviation, relative = _deviations(noise, tolerance, ends)
    return np.asarray(relative * huber_weights(residual, deviation))


def _without_change(sums: Array, prior: Array) -> Array:
    """Eliminate the change of brightness, the last row of sums of products (m, P, k, k); `prior` (m, P) is the weight
    that draws it to zero.
    """
    own = sums[..., -1:, -1:] + prior[..., None, None]
    return np.asarray(sums[..., :-1, :-1] - sums[..., :-1, -1:] @ sums[..., -1:, :-1] / own)


def _robust_deviation(residual: Image) -> float:
    """Return the standard deviation from the median of absolute values; 0 if there are none."""
    if not len(residual):
        return 0.0
    middle = len(residual) // 2
    lower = middle - 1 + len(residual) % 2
    ordered = np.partition(np.abs(residual), (lower, middle))  # as np.median, in a fraction of its time
    return NORMAL_MAD * float((ordered[lower] + ordered[middle]) * ordered.dtype.type(0.5))


def _medians(values: Image, counts: NDArray[np.intp]) -> Array:
    """Return the medians of consecutive groups of values with these counts, (n,); 0 for empty groups.

    All groups are sorted at once: by the group, then by the bits of the value, whose order is that of the numbers once
    those of negative ones are inverted. As with `np.median`, the mean of two values is of single precision.
    """
    bits = np.ascontiguousarray(values, np.float32).view(np.int32)
    group = np.repeat(np.arange(len(counts)), counts)
    ordered = np.sort((group << 32) + (bits ^ ((bits >> 31) & 0x7FFFFFFF))).astype(np.int32)
    ordered ^= (ordered >> 31) & 0x7FFFFFFF
    sorted_values = np.append(ordered.view(np.float32), np.float32(0))
    start = np.cumsum(counts) - counts
    lower, upper = sorted_values[start + np.maximum(counts - 1, 0) // 2], sorted_values[start + counts // 2]
    return np.where(counts > 0, (lower + upper) * np.float32(0.5), np.float32(0)).astype(float)


def wrenches(points: Image, slope: Image, focal: Image) -> Image:
    """Return the rows (m, x cross m) for brightness derivatives (2, N) at points in camera axes, shape (N, 6)."""
    x, y, z = points.T
    out = np.empty((6, len(points)), np.float32)
    mx, my = slope[0] * focal[0] / z, slope[1] * focal[1] / z
    mz = -(mx * x + my * y) / z
    out[:3] = mx, my, mz
    out[3:] = y * mz - z * my, z * mx - x * mz, x * my - y * mx
    return out.T


def huber_weights(residual: Image, deviation: Image) -> Image:
    """Return the weights of Huber's loss: 1 up to `HUBER` deviations, then falling as 1/|r|."""
    return np.asarray(
        np.minimum(np.float32(1), np.float32(HUBER) * deviation / np.maximum(np.abs(residual), np.float32(1e-12)))
    )


def huber_errors(residual: Image, deviation: Image) -> Image:
    """Return Huber's loss: quadratic up to `HUBER` deviations, then linear."""
    size, limit = np.abs(residual), np.float32(HUBER) * deviation
    inner = np.minimum(size, limit)
    return np.asarray(inner * (2 * size - inner))


def _pair_twists(Rc: Array, tc: Array) -> Array:
    """Return matrices (m, 12, 12) that take the world twists of a pair of frames to their cameras' axes and centres."""
    twist = camera_twist(Rc, tc)
    A = np.zeros((len(Rc) - 1, 12, 12))
    A[:, :6, :6], A[:, 6:, 6:] = twist[:-1], twist[1:]
    return A


def camera_twist(R_cam_world: Array, t_cam_world: Array) -> Array:
    """Return matrices (..., 6, 6) that take twists (v, omega) about the world's origin to the camera's axes and
    centre.
    """
    A = np.zeros((*t_cam_world.shape[:-1], 6, 6))
    A[..., :3, :3] = A[..., 3:, 3:] = R_cam_world
    A[..., :3, 3:] = rotations.skew(t_cam_world) @ R_cam_world
    return A
