"""The 2D keypoints of a performer as rays of the views' cameras."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..numerics.arrays import Array


@dataclass(frozen=True, eq=False)
class Keypoints:
    """Keypoints of one performer on F frames, in V views.

    Attributes
    ----------
    names : tuple of str, length L
    rays : ndarray, shape (V, F, L, 2)
        Normalized image coordinates (x / z, y / z) in camera axes, without lens distortion; NaN where a keypoint was
        not found.
    confidence : ndarray, shape (V, F, L)
        0 to 1.
    R_cam_world, t_cam_world : ndarray, shape (V, F, 3, 3) and (V, F, 3)
        Poses of the cameras: X_cam = R_cam_world X_world + t_cam_world, metres.
    """

    names: tuple[str, ...]
    rays: Array
    confidence: Array
    R_cam_world: Array
    t_cam_world: Array

    def __len__(self) -> int:
        return self.rays.shape[1]

    def __getitem__(self, frames: slice | Sequence[int] | NDArray[Any]) -> Keypoints:
        """Return the keypoints of some of the frames."""
        return replace(
            self,
            rays=self.rays[:, frames],
            confidence=self.confidence[:, frames],
            R_cam_world=self.R_cam_world[:, frames],
            t_cam_world=self.t_cam_world[:, frames],
        )

    def of_views(self, views: list[int]) -> Keypoints:
        """Return the keypoints of some of the views."""
        R, t = self.R_cam_world[views], self.t_cam_world[views]
        return Keypoints(self.names, self.rays[views], self.confidence[views], R, t)

    def of_landmarks(self, columns: Sequence[int]) -> Keypoints:
        """Return the keypoints of some of the landmarks."""
        names = tuple(self.names[i] for i in columns)
        return replace(self, names=names, rays=self.rays[:, :, columns], confidence=self.confidence[:, :, columns])

    def rays_to(self, view: int, R_cam_world: Array) -> Array:
        """Return the rays of one view, shape (F, L, 2), in the axes of a camera at the same place that stands still."""
        turns = R_cam_world @ np.swapaxes(self.R_cam_world[view], 1, 2)
        directions = np.concatenate([self.rays[view], np.ones((*self.rays.shape[1:3], 1))], axis=-1)
        turned = np.einsum("fab,flb->fla", turns, directions)
        return np.asarray(turned[..., :2] / turned[..., 2:])

    def residuals(self, points_world: Array) -> Array:
        """Distances of points (F, L, 3) from the rays along both image axes, metres, (V, F, L, 2); NaN if not found."""
        x = np.einsum("vfab,flb->vfla", self.R_cam_world, points_world) + self.t_cam_world[:, :, None]
        z = np.where(x[..., 2] > 0.1, x[..., 2], np.nan)
        return np.asarray(x[..., :2] - self.rays * z[..., None])

    def across(self) -> Array:
        """Derivatives of the residuals by the points' world coordinates, shape (V, F, L, 2, 3).

        Where a keypoint was not found, the derivatives are those of a ray along the optical axis.
        """
        R = self.R_cam_world[:, :, None]
        return R[..., :2, :] - np.nan_to_num(self.rays)[..., None] * R[..., 2:, :]
