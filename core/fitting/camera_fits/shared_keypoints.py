"""Keypoints that several cameras share, and estimates of these cameras and of the joints.

What a detector calls a hip is not the same point from every side, and that error is the same on all frames. Only
different kinds of joints therefore have independent errors.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...cameras.camera import Camera
from ...keypoints.keypoint_rays import Keypoints
from ...keypoints.triangulation import triangulate
from ...numerics.arrays import Array, Bools, Ints
from .resection import adjusted

_FRAMES_PER_CORRELATION = 3  # frames used out of those with correlated errors; more add nothing


@dataclass(frozen=True, eq=False)
class SharedKeypoints:
    """Keypoints of all performers on some frames.

    Attributes
    ----------
    rays : ndarray, shape (V, F, L, 2)
        See `Keypoints`.
    confidence : ndarray, shape (V, F, L)
        0 to 1, 0 where not found.
    R_cam_world, t_cam_world : ndarray, shape (V, F, 3, 3) and (V, F, 3)
    points_world : ndarray, shape (F, L, 3)
        Triangulated, metres; NaN where no two views agree.
    kind : ndarray of int, shape (L,)
        The kind of each joint. Joints of one kind, left and right and of all performers, have correlated errors.
    focal : ndarray, shape (V,)
        Pixels.
    correlated : float
        Number of neighbouring frames, of these F, whose errors are correlated and which count as one.
    """

    rays: Array
    confidence: Array
    R_cam_world: Array
    t_cam_world: Array
    points_world: Array
    kind: Ints
    focal: Array
    correlated: float

    @classmethod
    def of(cls, performers: Sequence[Keypoints], cameras: Sequence[Camera], correlated: float) -> SharedKeypoints:
        """Join the keypoints of all performers; `correlated` is a number of frames of the shot."""
        step = max(1, int(correlated / _FRAMES_PER_CORRELATION))
        chosen = [keypoints[::step] for keypoints in performers]
        kinds = [name[1:] if name[0] in "LR" else name for keypoints in chosen for name in keypoints.names]
        numbers = {kind: i for i, kind in enumerate(dict.fromkeys(kinds))}
        return cls(
            rays=np.concatenate([keypoints.rays for keypoints in chosen], axis=2),
            confidence=np.concatenate([keypoints.confidence for keypoints in chosen], axis=2),
            R_cam_world=chosen[0].R_cam_world,
            t_cam_world=chosen[0].t_cam_world,
            points_world=np.concatenate([triangulate(keypoints)[0] for keypoints in chosen], axis=1),
            kind=np.array([numbers[kind] for kind in kinds], np.int64),
            focal=np.array([camera.matrix[[0, 1], [0, 1]].mean() for camera in cameras]),
            correlated=max(1.0, correlated / step),
        )

    def found(self) -> Bools:
        """Return which keypoints were found and can be triangulated, shape (V, F, L)."""
        known = np.isfinite(self.rays).all(axis=-1) & (self.confidence > 0)
        return np.asarray(known & np.isfinite(self.points_world).all(axis=-1))

    def kinds_seen(self) -> Ints:
        """Return how many kinds of joints each view shares with another, shape (V,)."""
        shared = self.found() & (self.found().sum(axis=0) >= 2)
        return np.array([len(np.unique(self.kind[view.any(axis=0)])) for view in shared])


@dataclass(frozen=True, eq=False)
class CameraEstimate:
    """An estimate of cameras and joints.

    Attributes
    ----------
    change : ndarray, shape (V, 7)
        Change of every camera since the start, see `core.fitting.camera_fits.resection.adjusted`.
    points_world : ndarray, shape (F, L, 3)
        Positions of the joints, metres.
    """

    change: Array
    points_world: Array

    def cameras(self, before: Sequence[Camera]) -> list[Camera]:
        """Return the cameras after the change."""
        return [adjusted(camera, change) for camera, change in zip(before, self.change, strict=True)]

    def moved(self, step: tuple[Array, Array]) -> CameraEstimate:
        """Return the estimate after a step of the cameras (7 V,) and of the joints (F, L, 3)."""
        cameras, points = step
        return CameraEstimate(self.change + cameras.reshape(self.change.shape), self.points_world + points)
