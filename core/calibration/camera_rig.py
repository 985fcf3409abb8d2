"""The unknowns of a calibration: the cameras with their clocks, and the wand on every frame."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..cameras.camera import Camera
from ..numerics import rotations
from ..numerics.arrays import Array, Ints

TURN, SHIFT, FOCAL, CENTRE, K1, K2, OFFSET, DRIFT = slice(0, 3), slice(3, 6), 6, slice(7, 9), 9, 10, 11, 12
CAMERA_DOF = 13
"""Unknowns of a camera: rotation (3) and translation (3) of its frame, logarithm of the focal length, principal point
(2), k1, k2, offset, drift."""
WAND_DOF = 5
"""Unknowns of a wand on a frame: its middle (3), and its direction along the two axes of `tangents`."""
COEFFICIENTS = 14
"""Length of OpenCV's longest list of distortion coefficients."""
_ORDER = 4
"""Number of frames from which positions between frames are interpolated."""


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
        """Return the same cameras in a world whose points are R x + t."""
        turned = self.R_cam_world @ R.T
        return replace(self, R_cam_world=turned, t_cam_world=self.t_cam_world - turned @ t)

    def scaled(self, scale: float) -> Rig:
        """Return the same cameras in a world that is so many times as large."""
        return replace(self, t_cam_world=scale * self.t_cam_world)


def rig_of(cameras: Sequence[Camera]) -> Rig:
    """Return cameras that were solved before as a rig with the capture's clock."""
    C = len(cameras)
    distortions = np.zeros((C, COEFFICIENTS))
    for c, camera in enumerate(cameras):
        distortions[c, : len(camera.distortions)] = camera.distortions
    return Rig(
        tuple(camera.name for camera in cameras),
        np.array([camera.size for camera in cameras]),
        np.stack([camera.R_cam_world[0] for camera in cameras]),
        np.stack([camera.t_cam_world[0] for camera in cameras]),
        np.stack([camera.matrix[[0, 1], [0, 1]] for camera in cameras]),
        np.stack([camera.matrix[:2, 2] for camera in cameras]),
        distortions,
        np.zeros(C),
        np.zeros(C),
        np.ones(C),
    )


@dataclass(frozen=True, eq=False)
class Wand:
    """A wand of known length on n frames.

    Attributes
    ----------
    frames : ndarray of int, shape (n,)
        Frames of the capture, increasing.
    middle : ndarray, shape (n, 3)
        Metres, world.
    direction : ndarray, shape (n, 3)
        Unit vectors from the second end to the first.
    length : float
        Metres.
    """

    frames: Ints
    middle: Array
    direction: Array
    length: float

    def __len__(self) -> int:
        return len(self.frames)

    @property
    def ends_world(self) -> Array:
        """Both ends, shape (n, 2, 3), metres."""
        half = self.length / 2 * self.direction
        return np.stack([self.middle + half, self.middle - half], axis=1)

    def moved(self, step: Array) -> Wand:
        """Return the wand after a step of shape (n, 5)."""
        direction = self.direction + np.einsum("nij,nj->ni", tangents(self.direction), step[:, 3:])
        direction /= np.linalg.norm(direction, axis=1, keepdims=True)
        return replace(self, middle=self.middle + step[:, :3], direction=direction)

    def in_world(self, R: Array, t: Array) -> Wand:
        """Return the same wand in a world whose points are R x + t."""
        return replace(self, middle=self.middle @ R.T + t, direction=self.direction @ R.T)

    def scaled(self, scale: float) -> Wand:
        """Return the same wand in a world that is so many times as large."""
        return replace(self, middle=scale * self.middle, length=scale * self.length)

    def take(self, chosen: NDArray[Any]) -> Wand:
        """Return the wand on some of its frames."""
        return Wand(self.frames[chosen], self.middle[chosen], self.direction[chosen], self.length)


def tangents(direction: Array) -> Array:
    """Return two unit vectors perpendicular to each direction (n, 3) and to each other, shape (n, 3, 2)."""
    axis = np.eye(3)[np.argmin(np.abs(direction), axis=1)]
    first = np.cross(direction, axis)
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    return np.stack([first, np.cross(direction, first)], axis=-1)


@dataclass(frozen=True, eq=False)
class Stencil:
    """Weights of cubic Lagrange interpolation between frames.

    Attributes
    ----------
    nodes : ndarray of int, shape (n, 4)
        Indices of the frames that are interpolated.
    weights : ndarray, shape (n, 4)
        Weights of their values.
    slopes : ndarray, shape (n, 4)
        Weights of their values in the derivative, per frame.
    reached : ndarray of bool, shape (n,)
        Whether there is a frame within half a frame's distance.
    """

    nodes: Ints
    weights: Array
    slopes: Array
    reached: NDArray[np.bool_]

    @classmethod
    def create(cls, frames: Ints, times: Array) -> Stencil:
        """Return the interpolation of increasing frames at some times; times in gaps are not reached."""
        start, stop = _runs(frames)
        nearest = np.clip(np.searchsorted(frames, np.floor(times + 0.5)), 0, len(frames) - 1)
        reached = np.abs(frames[nearest] - times) <= 0.5 + 1e-9
        size = np.minimum(stop[nearest] - start[nearest], _ORDER)
        before = nearest - (times < frames[nearest])  # the frame at or before the time
        first = np.clip(before - 1, start[nearest], stop[nearest] - size)
        x = times - frames[first]
        nodes = np.minimum(first[:, None] + np.arange(_ORDER), len(frames) - 1)
        weights, slopes = np.zeros((2, len(times), _ORDER))
        for m in range(1, _ORDER + 1):
            rows = size == m
            powers = x[rows, None] ** np.arange(m)
            basis = np.linalg.inv(np.vander(np.arange(m), increasing=True))
            weights[rows, :m] = powers @ basis
            slopes[rows, :m] = powers[:, :-1] @ (np.arange(1, m)[:, None] * basis[1:])
        whole = np.abs(frames[nearest] - times) < 1e-12
        weights[whole] = np.arange(_ORDER) == (nearest - first)[whole, None]
        return cls(nodes, weights, slopes, reached)

    def value(self, values: Array) -> Array:
        """Interpolated values, shape (n, ...)."""
        return np.asarray(np.einsum("nk,nk...->n...", self.weights, values[self.nodes]))

    def slope(self, values: Array) -> Array:
        """Their derivatives, per frame."""
        return np.asarray(np.einsum("nk,nk...->n...", self.slopes, values[self.nodes]))


def _runs(frames: Ints) -> tuple[Ints, Ints]:
    """Return for each frame the first index of its run of consecutive frames, and the index after the last."""
    cuts = np.flatnonzero(np.diff(frames) != 1) + 1
    edges = np.concatenate([[0], cuts, [len(frames)]])
    run = np.repeat(np.arange(len(edges) - 1), np.diff(edges))
    return edges[:-1][run], edges[1:][run]
