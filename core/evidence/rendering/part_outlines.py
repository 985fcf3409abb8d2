"""Outlines of posed parts in a view, as the label images draw them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...cameras.camera import Camera
from ...numerics.arrays import Array, Bools
from .part_geometry import Geometry

FRACTION_BITS = 4
"""Bits after the point of the corners that OpenCV fills."""
_MAX_COORDINATE = 1 << 20
_APART = 8  # between groups whose elements are sorted by angles


@dataclass(frozen=True, eq=False)
class Outlines:
    """The convex outlines of the P parts in n frames, where they are drawn.

    Attributes
    ----------
    uv : ndarray, shape (K, 2)
        Corners of the outlines in the image, pixels; each outline runs clockwise as the image is seen.
    depth : ndarray, shape (K,)
        Depth z of the corners, metres.
    ends : ndarray of int, shape (n P + 1,)
        Corners ends[k] to ends[k + 1] are those of part k % P in frame k // P.
    """

    uv: Array
    depth: Array
    ends: NDArray[np.intp]

    @classmethod
    def of(cls, geometry: Geometry, camera: Camera, points: Array, facing: Bools, drawn: Bools) -> Outlines:
        """Compute the outlines of the parts that are drawn, (n, P), from vertices in camera axes, (n, 3, V), and which
        faces are front faces, (n, N).
        """
        n, P = drawn.shape
        looking = (geometry.meeting @ facing.T.astype(np.int64)).T
        edge = (looking > 0) & (looking < geometry.meeting.sum(axis=1)) & drawn[:, geometry.owner]
        frame, vertex = np.nonzero(edge)
        x, y, z = points[frame, :, vertex].T
        uv = np.stack([x / z, y / z], axis=1) @ camera.matrix[:2, :2].T + camera.matrix[:2, 2]
        group = frame * P + geometry.owner[vertex]
        count = np.bincount(group, minlength=n * P)
        sums = np.stack([np.bincount(group, a, minlength=n * P) for a in uv.T], axis=1)
        middle = sums / np.maximum(count, 1)[:, None]
        u, v = (uv - middle[group]).T
        # The groups are in order, and an angle is no wider than 2 pi: sorting by both at once is many times as fast.
        order = np.argsort(_APART * group + np.arctan2(v, u), kind="stable")
        return cls(uv[order], z[order], np.concatenate([[0], np.cumsum(count)]))

    @property
    def group(self) -> NDArray[np.intp]:
        """The k that each corner belongs to, shape (K,)."""
        return np.repeat(np.arange(len(self.ends) - 1), np.diff(self.ends))

    @property
    def following(self) -> NDArray[np.intp]:
        """Which of the K corners comes after each on its outline, shape (K,)."""
        after = np.arange(1, len(self.uv) + 1)
        there = np.diff(self.ends) > 0
        after[self.ends[1:][there] - 1] = self.ends[:-1][there]
        return after

    @property
    def fixed_point(self) -> NDArray[np.int32]:
        """The corners as OpenCV fills them: whole numbers, with `FRACTION_BITS` after the point, shape (K, 2)."""
        return np.clip(np.round(self.uv * (1 << FRACTION_BITS)), -_MAX_COORDINATE, _MAX_COORDINATE).astype(np.int32)

    def boxes(self, starts: NDArray[np.intp], size: tuple[int, ...]) -> NDArray[np.intp]:
        """Boxes, within images of a size (width, height), of the pixels that runs of filled outlines may cover.

        Parameters
        ----------
        starts : ndarray of int, shape (M,)
            The k of the first outline of each run.
        size : tuple of int

        Returns
        -------
        ndarray of int, shape (2, M, 2)
            Left and top, right and bottom (exclusive); where there is no outline, the latter are not larger.
        """
        begins = self.ends[starts]
        there = np.diff(begins, append=len(self.uv)) > 0
        boxes = np.stack([np.full((len(starts), 2), np.inf), np.full((len(starts), 2), -np.inf)])
        boxes[0, there] = np.minimum.reduceat(self.uv, begins[there], axis=0)
        boxes[1, there] = np.maximum.reduceat(self.uv, begins[there], axis=0)
        # A filled outline covers the pixels that it runs through, too.
        return np.clip(boxes + [[[-1]], [[2]]], 0, size).astype(np.intp)

    @property
    def areas(self) -> Array:
        """Number of pixels that each filled outline covers if nothing hides it, at least 1, shape (n P,)."""
        (u, v), after = self.uv.T, self.following
        twice = np.bincount(self.group, u * v[after] - u[after] * v, minlength=len(self.ends) - 1)
        length = np.hypot(u[after] - u, v[after] - v)
        # A filled outline also covers the pixels that it runs through: half its length more than its area.
        return np.maximum((twice + np.bincount(self.group, length, minlength=len(twice))) / 2, 1.0)
