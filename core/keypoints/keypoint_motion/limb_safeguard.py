"""Limbs that a fit has lost are posed again on the triangulated points."""

from __future__ import annotations

import numpy as np
import scipy  # its parts are loaded when they are used
from numpy.typing import NDArray

from ...body import Body, part_poses
from ...body.motion import Motion
from ...numerics.arrays import Array
from ..keypoint_offsets import KeypointOffsets
from ..keypoint_rays import Keypoints
from ..keypoint_sigmas import GEMAN_MCCLURE_SCALE
from .closed_form import LIMB_CHAINS, closed_form_limb

LOST_EXCESS = 2.0
"""A limb is lost if its squared error in the views exceeds that of the triangulated points by this, in units of the
variance, averaged over `LOST_WINDOW`. With errors of the usual size the excess is below one."""
LOST_WINDOW = 0.1
"""Window of that average, seconds. A lost limb is posed again for the same time before and after as well."""


def repose_lost_limbs(
    body: Body,
    motion: Motion,
    places: KeypointOffsets,
    *,
    keypoints: Keypoints,
    points_world: Array,
    sigma: Array,
    fps: float,
) -> Motion | None:
    """Return a motion whose lost limbs are posed on points in closed form; None if no limb is lost.

    Parameters
    ----------
    body : Body
    motion : Motion
        F poses.
    places : KeypointOffsets
    keypoints : Keypoints
    points_world : ndarray, shape (F, L, 3)
        The triangulated keypoints, metres; NaN where not known.
    sigma : ndarray, shape (V, L)
        Standard deviations of the detector, metres.
    fps : float
    """
    poses, names = part_poses(body, motion), list(keypoints.names)
    aims = points_world - np.einsum("flab,lb->fla", poses[0][:, places.parts], places.offsets)
    worse = _mean_error(keypoints, places.world(poses), sigma) - _mean_error(keypoints, points_world, sigma)
    rotations = motion.rotations
    for limb in LIMB_CHAINS:
        for side in "LR":
            ends = [side + joint for joint in limb.joints[1:]]
            if f"{limb.upper}.{side}" not in body.names or not set(ends) <= set(names):
                continue
            columns = [names.index(end) for end in ends]
            lost = _lost_frames(worse[:, columns].max(axis=1), fps)
            lost &= np.isfinite(aims[:, columns]).all(axis=(1, 2))
            if lost.any():
                so_far = Motion(motion.translations, rotations)
                posed = closed_form_limb(body, so_far, limb, side, aims[:, columns], fps=fps)
                chosen = lost[:, None] & np.isin(np.arange(len(body)), limb.parts(body, side))
                rotations = np.where(chosen[..., None, None], posed, rotations)
    return None if rotations is motion.rotations else Motion(motion.translations, rotations)


def _mean_error(keypoints: Keypoints, points_world: Array, sigma: Array) -> Array:
    """Mean over the views of robust squared errors, in units of the variance, (F, L); 0 where nothing is known."""
    error = np.sum(keypoints.residuals(points_world) ** 2, axis=-1) / sigma[:, None] ** 2
    known = keypoints.confidence * np.isfinite(error)
    total = np.sum(known * np.nan_to_num(np.minimum(error, GEMAN_MCCLURE_SCALE**2)), axis=0)
    return np.asarray(total / np.maximum(known.sum(axis=0), 1e-9))


def _lost_frames(worse: Array, fps: float) -> NDArray[np.bool_]:
    """Return the frames on which the mean of `worse` (F,) over `LOST_WINDOW` exceeds `LOST_EXCESS`, and their
    neighbours, (F,).
    """
    span = max(1, round(LOST_WINDOW * fps))
    lost = scipy.ndimage.uniform_filter1d(worse, span, mode="nearest") > LOST_EXCESS
    return np.asarray(scipy.ndimage.binary_dilation(lost, iterations=span)) if lost.any() else lost
