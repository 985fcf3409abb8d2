"""A mesh of the zero surface of a distance function, by surface nets (S. F. F. Gibson, MICCAI 1998)."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import RegularGridInterpolator

Array = NDArray[np.float64]


def surface_nets(
    distance: Callable[[Array], Array], low: Array, high: Array, voxel: float
) -> tuple[Array, NDArray[np.int64]]:
    """Mesh the surface distance = 0 within a box.

    Parameters
    ----------
    distance : callable
        Of points (N, 3), metres; negative inside.
    low, high : ndarray, shape (3,)
        The box, metres; the surface must not leave it.
    voxel : float
        Size of the cells, metres.

    Returns
    -------
    vertices : ndarray, shape (V, 3)
    quads : ndarray of int, shape (Q, 4)
        Counter-clockwise seen from outside.
    """
    field = _field(distance, low, high, voxel)
    counts = np.array(field.shape)
    inside = field < 0
    corners = np.zeros([*(counts - 1)], dtype=int)
    for dx, dy, dz in np.ndindex(2, 2, 2):
        corners += inside[dx : counts[0] - 1 + dx, dy : counts[1] - 1 + dy, dz : counts[2] - 1 + dz]
    cells = np.argwhere((corners > 0) & (corners < 8))
    index = np.full(corners.shape, -1)
    index[tuple(cells.T)] = np.arange(len(cells))
    vertices = low + voxel * (cells + 0.5)
    for _ in range(3):
        vertices = _towards_surface(distance, vertices, voxel)
    return vertices, np.concatenate([_quads(inside, index, axis) for axis in range(3)])


def _field(distance: Callable[[Array], Array], low: Array, high: Array, voxel: float) -> Array:
    """Distances on a grid: exact near the surface, interpolated from a coarser grid elsewhere."""
    step = 4 * voxel
    counts = np.ceil((high - low) / step).astype(int) + 1
    coarse = distance(low + step * np.indices(counts).reshape(3, -1).T).reshape(counts)
    fine = 4 * (counts - 1) + 1
    between = RegularGridInterpolator([np.arange(n) for n in counts], coarse)
    field = between(np.indices(fine).reshape(3, -1).T / 4).reshape(fine)
    near = np.argwhere(np.abs(field) < 2 * step)
    field[tuple(near.T)] = distance(low + voxel * near)
    return field


def _towards_surface(distance: Callable[[Array], Array], points: Array, voxel: float) -> Array:
    """One Newton step along the gradient, kept within a cell."""
    h = 0.1 * voxel
    rise = [distance(points + h * e) - distance(points - h * e) for e in np.eye(3)]
    gradient = np.stack(rise, axis=1) / (2 * h)
    step = -distance(points)[:, None] * gradient / np.maximum(np.sum(gradient**2, axis=1, keepdims=True), 0.1)
    return points + np.clip(step, -0.6 * voxel, 0.6 * voxel)


def _quads(inside: NDArray[np.bool_], index: NDArray[np.int64], axis: int) -> NDArray[np.int64]:
    """A quad of the four cells round every grid edge along `axis` that crosses the surface."""
    u, v = (axis + 1) % 3, (axis + 2) % 3
    before, after = (np.take(inside, range(s, inside.shape[axis] - 1 + s), axis=axis) for s in (0, 1))
    edges = np.argwhere(before != after)
    around = []
    for du, dv in ((-1, -1), (0, -1), (0, 0), (-1, 0)):
        cell = edges.copy()
        cell[:, u] += du
        cell[:, v] += dv
        around.append(index[tuple(cell.T)])
    quads = np.stack(around, axis=1)
    leaving = before[tuple(edges.T)]
    return np.where(leaving[:, None], quads, quads[:, ::-1])
