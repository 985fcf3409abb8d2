"""Where a person faces, from keypoints that do not depend on which is left and which is right: face and feet."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ...numerics.arrays import Array
from ..keypoint_rays import Keypoints
from ..triangulation import least_squares_points

FACE = (("Nose",), ("LEar", "REar"))
FEET = (("LBigToe", "RBigToe"), ("LHeel", "RHeel"))
FEET_WITHOUT_HEELS = (("LBigToe", "RBigToe"), ("LAnkle", "RAnkle"))
"""What is in front of what: middles of keypoints."""
_HIPS, _SHOULDERS = ("LHip", "RHip"), ("LShoulder", "RShoulder")


def forward_directions(keypoints: Keypoints) -> tuple[Array, Array]:
    """Return where face and feet point, and the direction of the trunk, from hips to shoulders, on every frame.

    Returns
    -------
    forward : ndarray, shape (N, F, 3)
        Unit vectors in the world, of N cues; NaN where unknown.
    trunk : ndarray, shape (F, 3)
        Unit vectors; NaN where unknown.
    """
    feet = FEET if set(FEET[1]) <= set(keypoints.names) else FEET_WITHOUT_HEELS
    groups = [group for cue in (FACE, feet) for group in cue]
    middles = _middles(keypoints, (*groups, _HIPS, _SHOULDERS))
    forward = [middles[:, 0] - middles[:, 1], middles[:, 2] - middles[:, 3]]
    return _unit(np.array(forward)), _unit(middles[:, 5] - middles[:, 4])


def _middles(keypoints: Keypoints, groups: Sequence[Sequence[str]]) -> Array:
    """Triangulate the middles of groups of keypoints in the pictures, metres, (F, G, 3); NaN where unknown."""
    V, F, _ = keypoints.confidence.shape
    rays, confidence = np.full((V, F, len(groups), 2), np.nan), np.zeros((V, F, len(groups)))
    for k, group in enumerate(groups):
        if set(group) <= set(keypoints.names):
            columns = [keypoints.names.index(name) for name in group]
            rays[:, :, k] = keypoints.rays[:, :, columns].mean(axis=2)
            confidence[:, :, k] = keypoints.confidence[:, :, columns].min(axis=2)
    middles = replace(keypoints, names=tuple(map("-".join, groups)), rays=rays, confidence=confidence)
    return least_squares_points(middles, confidence * np.isfinite(rays).all(axis=-1))


def _unit(vectors: Array) -> Array:
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return np.where(length > 0, vectors / np.where(length > 0, length, 1.0), np.nan)
