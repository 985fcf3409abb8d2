"""What several views agree on before any motion is fitted: points in space, left and right, and the detector's errors.

A motion that is too smooth leaves large residuals. If these were taken for errors of the detector, the motion would
become smoother still, until fast limbs are lost. Triangulated points do not depend on any assumed smoothness.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass, replace

import numpy as np
import scipy  # its parts are loaded when they are used
from numpy.typing import NDArray

from ..numerics.arrays import Array
from ..numerics.resampling import gaps_filled
from .keypoint_rays import Keypoints
from .keypoint_sigmas import sigmas_of_lengths
from .left_and_right.left_right import correct_sides, swap_sides, with_exchanged
from .left_and_right.side_paths import likeliest_sides
from .triangulation import LEAP_DISTANCE, triangulate

COMPARISON_WINDOW = 0.1
"""A point is compared with those up to this long before and after it, seconds."""
AVERAGING_TIME = 0.04
"""Time over which points are averaged before a body is posed on them, seconds."""
MAX_BRIDGED_TIME = 0.6
"""Longest time between two certain positions of a point across which a straight line says where it is, seconds."""
MIDPOINTS = {"Neck": "Shoulder", "Hip": "Hip", "MidHip": "Hip"}
"""Keypoints that many layouts define as the middle of a left and a right one."""
MIDPOINT_TOLERANCE = 0.02
"""A keypoint was computed from two others if it is this close to their middle, as a share of their distance."""


@dataclass(frozen=True, eq=False)
class ViewAgreement:
    """What the views agree on of one performer's keypoints.

    Attributes
    ----------
    keypoints : Keypoints
        Left and right corrected where views contradict one another; without midpoints.
    changed : ndarray of bool, shape (V, F, L)
        Where left and right were exchanged.
    points_world : ndarray, shape (F, L, 3)
        Triangulated points without those that leap, metres; NaN where no two views agree.
    confidence : ndarray, shape (V, F, L)
        Confidence of the keypoints that agree with the points, else 0.
    sigma : ndarray, shape (V, L), or None
        Standard deviations of the detector, metres; None if no two views agree on anything.
    fps : float
    """

    keypoints: Keypoints
    changed: NDArray[np.bool_]
    points_world: Array
    confidence: Array
    sigma: Array | None
    fps: float

    @classmethod
    def of(cls, keypoints: Keypoints, fps: float) -> ViewAgreement:
        """Correct left and right of keypoints where views contradict one another, and triangulate them."""
        own = without_midpoints(keypoints)
        changed = steady = likeliest_sides(own, fps)
        sided = likely = with_exchanged(own, swap_sides(own), steady)
        points, inliers = triangulate(sided, fps)
        for _ in range(2):
            before = changed
            sided, corrected = correct_sides(likely, _expected(points, inliers, fps))
            changed = steady ^ corrected
            if (changed == before).all():
                break
            points, inliers = triangulate(sided, fps)
        points = without_leaps(points, fps)
        inliers = inliers & np.isfinite(points).all(axis=-1)
        sigma = view_sigmas(sided, points, inliers) if inliers.any() else None
        return cls(sided, changed, points, inliers * sided.confidence, sigma, fps)

    def __getitem__(self, frames: slice) -> ViewAgreement:
        """Return what they agree on of some of the frames."""
        return replace(
            self,
            keypoints=self.keypoints[frames],
            changed=self.changed[:, frames],
            points_world=self.points_world[frames],
            confidence=self.confidence[:, frames],
        )

    def averaged(self) -> Array:
        """Return the points averaged over a few frames, metres, (F, L, 3); see the function `averaged`."""
        return np.where(np.isfinite(self.points_world), averaged(self.points_world, self.fps), np.nan)


def without_midpoints(keypoints: Keypoints) -> Keypoints:
    """Return the keypoints without exact middles of two others, which would otherwise count twice."""
    names, confidence = keypoints.names, keypoints.confidence.copy()
    for midpoint, joint in MIDPOINTS.items():
        if {midpoint, "L" + joint, "R" + joint} <= set(names):
            m, left, right = (names.index(name) for name in (midpoint, "L" + joint, "R" + joint))
            between = 0.5 * (keypoints.rays[:, :, left] + keypoints.rays[:, :, right])
            apart = np.linalg.norm(keypoints.rays[:, :, left] - keypoints.rays[:, :, right], axis=-1)
            off = np.linalg.norm(keypoints.rays[:, :, m] - between, axis=-1)
            both = np.isfinite(off) & (apart > 0)
            if both.any() and np.median(off[both] / apart[both]) < MIDPOINT_TOLERANCE:
                confidence[:, :, m] = 0.0
    return replace(keypoints, confidence=confidence)


def view_sigmas(keypoints: Keypoints, points_world: Array, inliers: NDArray[np.bool_]) -> Array:
    """Return robust standard deviations of every view's keypoints from triangulated points, metres, shape (V, L).

    Parameters
    ----------
    keypoints : Keypoints
    points_world : ndarray, shape (F, L, 3)
        NaN where not known.
    inliers : ndarray of bool, shape (V, F, L)
        The views from which each point was triangulated. Of the 2 N coordinates of N views, a point uses up 3.
    """
    size = np.linalg.norm(keypoints.residuals(points_world), axis=-1)
    views = np.maximum(inliers.sum(axis=0), 2)
    return sigmas_of_lengths(size * np.sqrt(2 * views / (2 * views - 3)), keypoints.confidence)


def _expected(points_world: Array, inliers: NDArray[np.bool_], fps: float) -> Array:
    """Return the expected positions of points (F, L, 3).

    A point on which only two views agree may be wrong, because one of them may have exchanged left and right. Without a
    third view to decide, it is expected between the positions before and after on which three views agree.
    """
    expected = running_median(without_leaps(points_world, fps), fps)
    across = bridged(np.where((inliers.sum(axis=0) > 2)[..., None], expected, np.nan), fps)
    return np.where(np.isfinite(across), across, expected)


def bridged(points_world: Array, fps: float) -> Array:
    """Return points (F, L, 3) with straight lines across gaps of up to `MAX_BRIDGED_TIME`."""
    out, frames = points_world.copy(), np.arange(len(points_world))
    for i in range(points_world.shape[1]):
        known = np.flatnonzero(np.isfinite(points_world[:, i]).all(axis=-1))
        if len(known) < 2:
            continue
        after = np.clip(np.searchsorted(known, frames), 1, len(known) - 1)
        between = (
            (frames > known[0]) & (frames < known[-1]) & (known[after] - known[after - 1] <= MAX_BRIDGED_TIME * fps)
        )
        out[between, i] = gaps_filled(points_world[:, i])[between]
    return out


def running_median(points_world: Array, fps: float) -> Array:
    """Return running medians of points (F, L, 3) over `COMPARISON_WINDOW` before and after; NaN if none is known
    there.
    """
    half = max(1, round(COMPARISON_WINDOW * fps))
    padded = np.pad(points_world, ((half, half), (0, 0), (0, 0)), constant_values=np.nan)
    around = np.stack([padded[k : k + len(points_world)] for k in range(2 * half + 1)])
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # all values of a window may be NaN
        return np.asarray(np.nanmedian(around, axis=0))


def without_leaps(points_world: Array, fps: float) -> Array:
    """Return points (F, L, 3) with NaN for those that leap away from their positions before and after."""
    leaps = np.linalg.norm(points_world - running_median(points_world, fps), axis=-1) > LEAP_DISTANCE
    return np.where(leaps[..., None], np.nan, points_world)


def averaged(points_world: Array, fps: float) -> Array:
    """Return points (F, L, 3) without gaps, averaged over a few frames; NaN for a point that is never known.

    During a gap a point moves with the points that are known on all frames, and otherwise in a straight line.
    """
    lasting = np.isfinite(points_world).all(axis=(0, 2))
    carrier = points_world[:, lasting].mean(axis=1) if lasting.any() else np.zeros((len(points_world), 3))
    filled = np.stack([gaps_filled(points - carrier) + carrier for points in np.moveaxis(points_world, 1, 0)], axis=1)
    return np.asarray(scipy.ndimage.gaussian_filter1d(filled, AVERAGING_TIME * fps / 2, axis=0, mode="nearest"))
