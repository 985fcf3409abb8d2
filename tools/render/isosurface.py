"""Triangle meshes of implicit surfaces, by scikit-image's marching cubes."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from kfmocap.core.numerics.arrays import Array
from numpy.typing import NDArray
from scipy.interpolate import RegularGridInterpolator
from skimage.measure import marching_cubes

_COARSENING = 4
"""Cells of the fine grid along the edge of a coarse one."""


def mesh_isosurface(
    distance: Callable[[Array], Array], low: Array, high: Array, voxel: float
) -> tuple[Array, NDArray[np.int64]]:
    """Mesh the surface on which a signed distance is zero.

    Parameters
    ----------
    distance : callable
        Signed distance, metres, of points of shape (N, 3); negative inside.
    low, high : ndarray, shape (3,)
        Two corners of a box that contains the whole surface, metres.
    voxel : float
        Edge length of the grid cells, metres.

    Returns
    -------
    vertices : ndarray, shape (V, 3)
        Metres.
    triangles : ndarray of int, shape (N, 3)
        Indices of vertices, counter-clockwise seen from outside.
    """
    field = _distance_grid(distance, low, high, voxel)
    # scikit-image winds triangles by the left-hand rule, so the gradient that rises outwards is declared as a descent.
    vertices, triangles, _, _ = marching_cubes(
        field, 0.0, spacing=(voxel,) * 3, gradient_direction="descent", allow_degenerate=False
    )
    return low + vertices, triangles.astype(np.int64)


def _distance_grid(distance: Callable[[Array], Array], low: Array, high: Array, voxel: float) -> Array:
    """Sample distances on a grid: exactly near the surface, interpolated from a coarser grid elsewhere."""
    step = _COARSENING * voxel
    counts = np.ceil((high - low) / step).astype(int) + 1
    coarse = distance(low + step * np.indices(counts).reshape(3, -1).T).reshape(counts)
    fine = _COARSENING * (counts - 1) + 1
    interpolated = RegularGridInterpolator([np.arange(n) for n in counts], coarse)
    field = interpolated(np.indices(fine).reshape(3, -1).T / _COARSENING).reshape(fine)
    near = np.argwhere(np.abs(field) < 2 * step)
    field[tuple(near.T)] = distance(low + voxel * near)
    return field
