"""Silhouettes of convex parts as lines in space: the edges between faces that face the eye and faces that do not."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull

from ..numerics.arrays import Array

Indices = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Solid:
    """The convex hull of points.

    Attributes
    ----------
    vertices : ndarray, shape (V, 3)
    triangles : ndarray of int, shape (N, 3)
    planes : ndarray, shape (N, 4)
        Outward unit normals n and offsets d of the triangles, n.x + d <= 0 inside.
    edges : ndarray of int, shape (E, 2)
        Pairs of vertices.
    sides : ndarray of int, shape (E, 2)
        The two triangles that meet in each edge.
    """

    vertices: Array
    triangles: Indices
    planes: Array
    edges: Indices
    sides: Indices

    @classmethod
    def of(cls, points: Array) -> Solid:
        """Return the hull of points (V, 3) that are not in one plane."""
        hull = ConvexHull(points)
        corners = np.array([[0, 1], [1, 2], [2, 0]])
        pairs = np.sort(hull.simplices[:, corners].reshape(-1, 2), axis=1)
        edges, which = np.unique(pairs, axis=0, return_inverse=True)
        triangle = np.repeat(np.arange(len(hull.simplices)), 3)
        sides = triangle[np.argsort(which.ravel(), kind="stable")].reshape(-1, 2)  # every edge has two
        return cls(points, hull.simplices.astype(np.int64), hull.equations, edges.astype(np.int64), sides)

    def silhouette(self, eye: Array) -> Indices:
        """Return the edges of the outline as seen from a point (3,), as pairs of vertices, shape (n, 2)."""
        facing = self.planes[:, :3] @ eye + self.planes[:, 3] > 0
        return np.asarray(self.edges[facing[self.sides[:, 0]] != facing[self.sides[:, 1]]])
