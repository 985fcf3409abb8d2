"""Correction of left and right, which detectors confuse: of the legs, of the arms, or of the whole body."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ...formats.keypoint_layouts import is_sided, mirrored_name
from ...numerics.arrays import Array
from ..keypoint_rays import Keypoints

EXCHANGED_GROUPS = (("Hip", "Knee", "Ankle", "BigToe", "Heel"), ("Shoulder", "Elbow", "Wrist", "Hand"), ("Eye", "Ear"))
"""Landmarks that are exchanged together."""
MAX_DISTANCE = 0.15
"""A keypoint that is farther from its expected position than this says nothing about its side, metres."""
MAX_ERROR_RATIO = 0.6
"""Left and right are exchanged if this lowers the error to less than this share."""


def correct_sides(keypoints: Keypoints, points_world: Array) -> tuple[Keypoints, NDArray[np.bool_]]:
    """Exchange left and right keypoints where this brings them nearer to their expected positions.

    Parameters
    ----------
    keypoints : Keypoints
    points_world : ndarray, shape (F, L, 3)
        Expected positions of the keypoints, metres, world; NaN where unknown.

    Returns
    -------
    keypoints : Keypoints
        The corrected ones.
    changed : ndarray of bool, shape (V, F, L)
        Which ones were exchanged.
    """
    other = swap_sides(keypoints)
    own, turned = (_cost(k, points_world) for k in (keypoints, other))
    changed = np.zeros(keypoints.confidence.shape, bool)
    for group in EXCHANGED_GROUPS:
        columns = [i for i, n in enumerate(keypoints.names) if is_sided(n) and n[1:] in group]
        kept, given = own[..., columns].sum(axis=-1), turned[..., columns].sum(axis=-1)
        changed[..., columns] = (given < MAX_ERROR_RATIO * kept)[..., None]
    return with_exchanged(keypoints, other, changed), changed


def swap_sides(keypoints: Keypoints) -> Keypoints:
    """Exchange left and right of all keypoints."""
    order = [
        keypoints.names.index(mirrored_name(n)) if mirrored_name(n) in keypoints.names else i
        for i, n in enumerate(keypoints.names)
    ]
    return replace(keypoints, rays=keypoints.rays[:, :, order], confidence=keypoints.confidence[:, :, order])


def sided_columns(names: Sequence[str], group: Sequence[str]) -> list[int]:
    """Return the columns of a group's landmarks of which both sides are among the keypoints."""
    return [i for i, n in enumerate(names) if is_sided(n) and n[1:] in group and mirrored_name(n) in names]


def with_exchanged(keypoints: Keypoints, other: Keypoints, changed: NDArray[np.bool_]) -> Keypoints:
    """Return the keypoints with those of `other`, which has left and right exchanged, where `changed` (V, F, L) says;
    it may have axes of length 1.
    """
    rays = np.where(changed[..., None], other.rays, keypoints.rays)
    return replace(keypoints, rays=rays, confidence=np.where(changed, other.confidence, keypoints.confidence))


def _cost(keypoints: Keypoints, points_world: Array) -> Array:
    """Truncated squared errors of the keypoints, weighted by confidence, shape (V, F, L)."""
    error = np.sum(keypoints.residuals(points_world) ** 2, axis=-1)
    return np.asarray(np.nan_to_num(keypoints.confidence * np.minimum(error, MAX_DISTANCE**2)))
