"""The unknowns of the cameras: places, lenses and clocks."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...cameras.camera import Camera
from ...numerics import rotations
from ...numerics.arrays import Array, Ints

TURN, SHIFT, FOCAL, CENTRE, K1, K2, OFFSET, DRIFT = slice(0, 3), slice(3, 6), 6, slice(7, 9), 9, 10, 11, 12
CAMERA_DOF = 13
"""Unknowns of a camera: rotation (3) and translation (3) of its frame, logarithm of the focal length, principal point
(2), k1, k2, offset, drift."""
COEFFICIENTS = 14
"""Length of OpenCV's longest list of distortion coefficients."""


@dataclass(frozen=True, eq=False)
class Rig:
    """Cameras and their clocks.

    Attributes
    ----------
    names : tuple of str, length C
    sizes : ndarray of int, shape (C, 2)
        Width and height, pixels.
    R_cam_world : ndarray, shape (C, 3, 3)
    t_cam_world : ndarray, shape (C, 3)
        Metres.
    focal : ndarray, shape (C, 2)
        Focal lengths along u and v, pixels.
    centre : ndarray, shape (C, 2)
        Principal points, pixels.
    distortions : ndarray, shape (C, 14)
        OpenCV's coefficients, zero where there are fewer.
    offset, drift, rate : ndarray, shape (C,)
        Frame s of the capture is frame rate (1 + drift) s + offset of the camera's video.
    """

    names: tuple[str, ...]
    sizes: Ints
    R_cam_world: Array
    t_cam_world: Array
    focal: Array
    centre: Array
    distortions: Array
    offset: Array
    drift: Array
    rate: Array

    def __len__(self) -> int:
        return len(self.names)

    @property
    def centres_world(self) -> Array:
        """Optical centres, shape (C, 3), metres."""
        return np.asarray(-np.einsum("cji,cj->ci", self.R_cam_world, self.t_cam_world))

    def matrix(self, c: int) -> Array:
        """Intrinsic matrix of a camera, shape (3, 3)."""
        (fu, fv), (cu, cv) = self.focal[c], self.centre[c]
        return np.array([[fu, 0, cu], [0, fv, cv], [0, 0, 1]])

    def camera(self, c: int, coefficients: int = 4) -> Camera:
        """One of the cameras, with the first of its distortion coefficients."""
        width, height = (int(n) for n in self.sizes[c])
        distortions = self.distortions[c, :coefficients]
        return Camera.create(
            self.names[c],
            (width, height),
            self.matrix(c),
            self.R_cam_world[c],
            self.t_cam_world[c],
            distortions=distortions,
        )

    def take(self, chosen: Sequence[int] | Ints) -> Rig:
        """Some of the cameras."""
        i = np.asarray(chosen, int)
        arrays = {k: v[i] for k, v in vars(self).items() if k != "names"}
        return Rig(tuple(self.names[c] for c in i), **arrays)

    def put(self, chosen: Sequence[int] | Ints, other: Rig) -> Rig:
        """Return the rig with some of its cameras replaced by those of another."""
        i = np.asarray(chosen, int)
        arrays = {k: v.copy() for k, v in vars(self).items() if k != "names"}
        for key, value in arrays.items():
            value[i] = getattr(other, key)
        return Rig(self.names, **arrays)

    def times(self, camera: Ints, frames: Array) -> Array:
        """Return the (fractional) frames of the capture at frames of the cameras' videos."""
        return np.asarray((frames - self.offset[camera]) / (self.rate * (1 + self.drift))[camera])

    def moved(self, step: Array) -> Rig:
        """Return the rig after a step of shape (C, 13)."""
        turn = rotations.exp(step[:, TURN])
        distortions = self.distortions.copy()
        distortions[:, :2] += step[:, [K1, K2]]
        return replace(
            self,
            R_cam_world=rotations.orthonormal(turn @ self.R_cam_world),
            t_cam_world=np.einsum("cij,cj->ci", turn, self.t_cam_world) + step[:, SHIFT],
            focal=self.focal * np.exp(step[:, FOCAL, None]),
            centre=self.centre + step[:, CENTRE],
            distortions=distortions,
            offset=self.offset + step[:, OFFSET],
            drift=self.drift + step[:, DRIFT],
        )

    def in_world(self, R: Array, t: Array) -> Rig:
        """Return the same cameras in a world whose points are R x + t, metres, with R (3, 3) and t (3,)."""
        turned = self.R_cam_world @ R.T
        return replace(self, R_cam_world=turned, t_cam_world=self.t_cam_world - turned @ t)

    def scaled(self, scale: float) -> Rig:
        """Return the same cameras in a world scaled by a factor."""
        return replace(self, t_cam_world=scale * self.t_cam_world)


def rig_of(cameras: Sequence[Camera]) -> Rig:
    """Return cameras that were solved before as a rig with the capture's clock."""
    C = len(cameras)
    distortions = np.zeros((C, COEFFICIENTS))
    for c, camera in enumerate(cameras):
        distortions[c, : len(camera.distortions)] = camera.distortions
    return Rig(
        names=tuple(camera.name for camera in cameras),
        sizes=np.array([camera.size for camera in cameras]),
        R_cam_world=np.stack([camera.R_cam_world[0] for camera in cameras]),
        t_cam_world=np.stack([camera.t_cam_world[0] for camera in cameras]),
        focal=np.stack([camera.matrix[[0, 1], [0, 1]] for camera in cameras]),
        centre=np.stack([camera.matrix[:2, 2] for camera in cameras]),
        distortions=distortions,
        offset=np.zeros(C),
        drift=np.zeros(C),
        rate=np.ones(C),
    )
