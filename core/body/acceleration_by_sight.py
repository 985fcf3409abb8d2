"""How smooth a motion is across the line of sight of a single camera, and along it.

A single view shows how a limb moves across the picture, but hardly how far it points towards the camera. If the motion
were expected to be as smooth either way, it would be held back from where the picture shows it, or errors in depth
would pass for movement. So usual accelerations are expected in depth, and larger ones across.

A part moves in depth where it turns about the axis that is perpendicular to its length and to the line of sight. A turn
about its own length is seen little, and counts as one in depth.
"""

from __future__ import annotations

import numpy as np

from ..numerics.arrays import Array
from .body import Body
from .kinematics import part_poses
from .motion import Motion

ACROSS_RATIO = 3.0
"""Ratio of the accelerations across the line of sight to those along it."""


def precision_by_sight(precision: Array, body: Body, motion: Motion, eye: Array, ratio: float = ACROSS_RATIO) -> Array:
    """Return the inverse covariances of accelerations that are larger across the line of sight than along it.

    Parameters
    ----------
    precision : ndarray, shape (N, D)
        Inverse variances of the accelerations along the line of sight.
    body : Body
    motion : Motion
        N poses.
    eye : ndarray, shape (N, 3)
        The camera's place on each of these frames.
    ratio : float

    Returns
    -------
    ndarray, shape (N, 1 + P, 3, 3)
        Of the root's place in the world, and of every part's turn in its own frame.
    """
    R, T = part_poses(body, motion)
    sight = T - eye[:, None]
    sight /= np.linalg.norm(sight, axis=-1, keepdims=True)
    along = np.stack([part.R_world_rest.T @ (part.tail_world - part.head_world) for part in body.parts])
    along /= np.linalg.norm(along, axis=-1, keepdims=True)
    in_depth = np.cross(along, np.einsum("npji,npj->npi", R, sight))
    place = _products(sight[:, :1])
    turns = _products(in_depth) + _products(along)
    kept = np.concatenate([place, turns], axis=1)
    share = ratio**-2 * np.eye(3) + (1 - ratio**-2) * kept
    root = np.sqrt(precision).reshape(*kept.shape[:3])
    return np.asarray(root[..., :, None] * share * root[..., None, :])


def _products(vectors: Array) -> Array:
    """Products of vectors (..., 3) with themselves, (..., 3, 3)."""
    return np.asarray(vectors[..., :, None] * vectors[..., None, :])
