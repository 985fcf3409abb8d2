"""Spatio-temporal gradient evidence by wrench accumulation (paper 1, equations (8) to (12)).

A pixel that shows a part in frame a is a fixed point of that part and looks the same in frame b (brightness
constancy). With m = (dE/du)(du/dx), the derivative of the brightness by the point, the pixel's row against the part's
twist is its wrench (m, x cross m). Products of wrenches are summed per part, twelve by twelve (six for frame a, six
for frame b), so the cost per pixel does not depend on the number of joints, and cameras simply add.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...cameras.camera import Camera
from ...numerics.arrays import Array, Bools
from ...numerics.robust_kernels import NORMAL_MAD
from ..smoothed_images import Image
from .compared_pixels import ComparedPixels
from .image_wrenches import camera_twist, wrenches
from .pixel_gains import MIN_NOISE, gains

HUBER_LIMIT = 1.345
"""Limit of Huber's loss between its quadratic and linear parts, standard deviations (95 % efficiency for normal
noise)."""
PART_PRIOR_PIXELS = 20.0
"""A part's own noise is drawn toward that of its pair of frames, and its change of brightness toward none, as by so
many pixels."""
_BATCH = 16  # groups of pixels, few enough to stay in the processor's cache


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

    def of_pairs(self, whole: Array) -> GradientSums:
        """Return the sums without those of damaged pairs, where `whole`, shape (m,), is 0; elsewhere it is 1."""
        return replace(
            self,
            H=self.H * whole[:, None, None, None],
            g=self.g * whole[:, None, None],
            energy=self.energy * whole,
            weight=self.weight * whole,
            count=self.count * whole,
            gain=self.gain * whole,
        )

    def of_parts(self, seen: Bools) -> GradientSums:
        """Return the sums with the normal equations of some parts alone, (m, P); paper 1, equation (38)."""
        return replace(self, H=self.H * seen[..., None, None], g=self.g * seen[..., None])

    def without_equations(self) -> GradientSums:
        """Return the sums without the normal equations."""
        return replace(self, H=self.H[:0].copy(), g=self.g[:0].copy())


def brightness_constancy(
    compared: ComparedPixels, tolerance: float, given_noise: Array | None = None, *, by_part: bool = False
) -> GradientSums:
    """Sum the brightness constancy constraint between neighbouring frames of one view.

    A pixel of a frame is used if its point is still visible on the next frame.

    Parameters
    ----------
    compared : ComparedPixels
        Those of n frames.
    tolerance : float
        Huber's limit in units of `HUBER_LIMIT` standard deviations: 1 near the solution, more far from it.
    given_noise : ndarray, shape (n - 1, 1 + P), optional
        The noise under which the cost is measured, see `GradientSums`; by default their own.
    by_part : bool
        Whether every part has a noise of its own, and may get brighter or darker as a whole.

    Returns
    -------
    GradientSums
        For the m = n - 1 pairs of neighbouring frames.
    """
    camera, labels = compared.camera, compared.labels
    m, P = len(labels.share) - 1, labels.share.shape[1]
    pixels, residual, seen = compared.pixels, compared.residual, compared.seen
    changes, noise = _residuals_of_parts(residual, seen, pixels.ends, P, by_part=by_part)
    change = np.repeat(changes.ravel(), np.diff(pixels.ends)).astype(np.float32)
    weight = _weights(residual - change, noise, tolerance, pixels.ends) * seen
    given = noise if given_noise is None else given_noise
    given = given if by_part else np.repeat(given[:, :1], 1 + P, axis=1)
    sigma, relative = _sigmas(given, tolerance, pixels.ends)
    error = relative * huber_errors(residual - change, sigma)
    count = np.bincount(pixels.frame, seen, minlength=m).astype(float)
    error_sum = np.bincount(pixels.frame, error * seen, minlength=m).astype(float)
    error_sum += PART_PRIOR_PIXELS * ((given[:, :1] / given[:, 1:]) ** 2 * changes**2).sum(axis=1)
    gain = gains(compared, (tolerance * given[pixels.frame, 0]).astype(np.float32))
    sums = _weighted_products(compared, weight, noise, by_part=by_part)
    A = _pair_twists(*camera.poses(compared.first, m + 1))[:, None]
    A_t = np.swapaxes(A, -1, -2)
    return GradientSums(
        H=A_t @ sums[..., :12, :12] @ A,
        g=(A_t @ sums[..., :12, 12:])[..., 0],
        energy=sums[..., 12, 12].sum(axis=1),
        weight=np.bincount(pixels.frame, weight, minlength=m).astype(float),
        noise=noise,
        density=np.prod(_focal_lengths(camera))
        * np.bincount(pixels.frame, labels.inverse_depth[: len(residual)] ** 2, minlength=m)
        / np.maximum(np.diff(pixels.ends[::P]), 1),
        count=count,
        cost=error_sum / np.maximum(count, 1),
        gain=np.bincount(pixels.frame, gain, minlength=m).astype(float),
    )


def _focal_lengths(camera: Camera) -> Image:
    return camera.matrix[[0, 1], [0, 1]].astype(np.float32)


def _weighted_products(compared: ComparedPixels, weight: Image, noise: Array, *, by_part: bool) -> Array:
    """Sum the products of the pixels' equations with themselves by pair of frames and part, shape (m, P, 13, 13): the
    derivatives of the residual by twists on the first frame (6) and on the second (6), and the residual.
    """
    pixels, residual, focal = compared.pixels, compared.residual, _focal_lengths(compared.camera)
    slope = 0.5 * (compared.here[1:] + compared.there[1:])
    rows = np.empty((14 if by_part else 13, len(residual)), np.float32)
    np.negative(wrenches(pixels.points_cam, slope, focal).T, out=rows[:6])
    rows[6:12] = wrenches(compared.points_there, slope, focal).T
    rows[12] = residual
    rows[13:] = 1
    m, P = len(noise), noise.shape[1] - 1
    sums = summed_products(rows, weight, pixels.ends).reshape(m, P, len(rows), len(rows))
    return _without_change(sums, PART_PRIOR_PIXELS * (noise[:, :1] / noise[:, 1:]) ** 2) if by_part else sums


def summed_products(
    rows: NDArray[np.floating[Any]], weight: NDArray[np.floating[Any]], ends: NDArray[np.intp]
) -> Array:
    """Return weighted sums of the products of columns (k, N) with themselves, over columns ends[i] to ends[i + 1].

    The shape is (len(ends) - 1, k, k). Sums in single precision might not be positive definite.
    """
    sums = np.zeros((len(ends) - 1, len(rows), len(rows)))
    for first in range(0, len(sums), _BATCH):
        bounds = ends[first : first + _BATCH + 1]
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
    of_pairs = [_robust_sigma(residual[a:b][seen[a:b]]) for a, b in pairwise(ends[::parts])]
    noise = np.repeat(np.maximum(of_pairs, MIN_NOISE)[:, None], 1 + parts, axis=1)
    change = np.zeros((len(of_pairs), parts))
    if by_part:
        own, count = residual[seen], np.diff(np.concatenate([[0], np.cumsum(seen)])[ends])
        share = count / (count + PART_PRIOR_PIXELS)
        brighter = share * _medians(own, count)
        apart = _medians(np.abs(own - np.repeat(brighter.astype(np.float32), count)), count)
        own_noise = np.sqrt(share * (NORMAL_MAD * apart) ** 2 + (1 - share) * np.repeat(noise[:, 0], parts) ** 2)
        change = brighter.reshape(change.shape)
        noise[:, 1:] = np.where(count > 0, own_noise, noise[:, 1:].ravel()).reshape(change.shape)
    return change, np.maximum(noise, MIN_NOISE)


def _sigmas(noise: Array, tolerance: float, ends: NDArray[np.intp]) -> tuple[Image, Image]:
    """Return the standard deviation of each pixel, and its inverse variance relative to that of its pair of frames."""
    each = np.repeat(noise[:, 1:].ravel(), np.diff(ends))
    relative = np.repeat((noise[:, :1] / noise[:, 1:]).ravel() ** 2, np.diff(ends))
    return (tolerance * each).astype(np.float32), relative.astype(np.float32)


def _weights(residual: Image, noise: Array, tolerance: float, ends: NDArray[np.intp]) -> Image:
    """Return the weights of pixels: Huber's, times the relative inverse variance of their part."""
    sigma, relative = _sigmas(noise, tolerance, ends)
    return np.asarray(relative * huber_weights(residual, sigma))


def _without_change(sums: Array, prior: Array) -> Array:
    """Eliminate the change of brightness, the last row of sums of products (m, P, k, k); `prior` (m, P) is the weight
    that draws it to zero.
    """
    own = sums[..., -1:, -1:] + prior[..., None, None]
    return np.asarray(sums[..., :-1, :-1] - sums[..., :-1, -1:] @ sums[..., -1:, :-1] / own)


def _robust_sigma(residual: Image) -> float:
    """Return the standard deviation from the median of absolute values; 0 if there are none."""
    if not len(residual):
        return 0.0
    middle = len(residual) // 2
    lower = middle - 1 + len(residual) % 2
    ordered = np.partition(np.abs(residual), (lower, middle))  # as np.median, in a fraction of its time
    return NORMAL_MAD * float((ordered[lower] + ordered[middle]) * ordered.dtype.type(0.5))


def _medians(values: Image, counts: NDArray[np.intp]) -> Array:
    """Return the medians of consecutive groups of values with these counts, (n,); 0 for empty groups. As with
    `np.median`, the mean of two values is of single precision.
    """
    ordered, ends = np.append(values, np.float32(0)).astype(np.float32), np.cumsum(counts)
    begins = ends - counts
    for a, b in zip(begins.tolist(), ends.tolist(), strict=True):  # a sort of all groups at once takes longer
        ordered[a:b].sort()
    lower, upper = ordered[begins + np.maximum(counts - 1, 0) // 2], ordered[begins + counts // 2]
    return np.where(counts > 0, (lower + upper) * np.float32(0.5), np.float32(0)).astype(float)


def huber_weights(residual: Image, sigma: Image) -> Image:
    """Return the weights of Huber's loss, same shape: 1 up to `HUBER_LIMIT` deviations, then falling as 1/|r|."""
    return np.asarray(
        np.minimum(np.float32(1), np.float32(HUBER_LIMIT) * sigma / np.maximum(np.abs(residual), np.float32(1e-12)))
    )


def huber_errors(residual: Image, sigma: Image) -> Image:
    """Return Huber's loss, same shape: quadratic up to `HUBER_LIMIT` deviations, then linear."""
    size, limit = np.abs(residual), np.float32(HUBER_LIMIT) * sigma
    inner = np.minimum(size, limit)
    return np.asarray(inner * (2 * size - inner))


def _pair_twists(Rc: Array, tc: Array) -> Array:
    """Return matrices (m, 12, 12) that take the world twists of a pair of frames to their cameras' axes and centres."""
    twist = camera_twist(Rc, tc)
    A = np.zeros((len(Rc) - 1, 12, 12))
    A[:, :6, :6], A[:, 6:, 6:] = twist[:-1], twist[1:]
    return A
