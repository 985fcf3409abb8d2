"""Interpolation between the frames on which a wand is known."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...numerics.arrays import Array, Ints

_ORDER = 4
"""Number of frames from which positions between frames are interpolated."""


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
        """Derivatives, per frame, of values (F, ...) at the times, shape (n, ...)."""
        return np.asarray(np.einsum("nk,nk...->n...", self.slopes, values[self.nodes]))


def _runs(frames: Ints) -> tuple[Ints, Ints]:
    """Return for each frame the first index of its run of consecutive frames, and the index after the last."""
    cuts = np.flatnonzero(np.diff(frames) != 1) + 1
    edges = np.concatenate([[0], cuts, [len(frames)]])
    run = np.repeat(np.arange(len(edges) - 1), np.diff(edges))
    return edges[:-1][run], edges[1:][run]
