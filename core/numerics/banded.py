"""Block-banded systems over the frames of a segment, in which any degree of freedom may be fixed."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from copy import copy

import numpy as np
from numpy.lib.stride_tricks import as_strided
from numpy.typing import NDArray
from scipy.linalg import cho_solve_banded, cholesky_banded
from scipy.linalg.lapack import dtrtri

from .arrays import Array
from .banded_blocks import BandedBlocks

FRAMES_AT_ONCE = 64
"""Number of frames whose blocks of the inverse are computed at a time."""


class BandedFactor:
    """Cholesky factor of a block-banded matrix, from which fixed unknowns are removed.

    Parameters
    ----------
    blocks : BandedBlocks
        F frames of D degrees of freedom.
    fixed : ndarray of bool, shape (F, D)
        Unknowns that do not move: their rows and columns are removed.
    damping : float
        Levenberg-Marquardt's: this share of the diagonal is added to it.
    """

    def __init__(self, blocks: BandedBlocks, fixed: NDArray[np.bool_], damping: float = 0.0) -> None:
        self.free = ~fixed
        stored = banded(blocks, fixed, damping)
        self._factor = cholesky_banded(stored, overwrite_ab=True, lower=True, check_finite=False)

    def solve(self, right: Array) -> Array:
        """Solve for a right-hand side of shape (F, D) or (F, D, n); fixed unknowns come out zero."""
        free = self.free.reshape(self.free.shape + (1,) * (right.ndim - 2))
        masked = np.where(free, right, 0.0).reshape(self.free.size, *right.shape[2:])
        return cho_solve_banded((self._factor, True), masked, check_finite=False).reshape(right.shape)

    def between(self, first: int, stop: int) -> BandedFactor:
        """Return the factor for frames first to stop - 1 alone: what is known of those before counts, and those after
        are held.
        """
        part, D = copy(self), self.free.shape[1]
        part.free, part._factor = self.free[first:stop], self._factor[:, first * D : stop * D]
        return part

    def log_determinant(self) -> float:
        """Logarithm of the determinant of the matrix of the free unknowns."""
        return float(2 * np.log(self._factor[0]).sum())

    def covariance(self, frame: int) -> Array:
        """Diagonal block of the inverse at one frame, shape (D, D): the covariance of that pose."""
        *_, (_, (diagonal, _, _)) = self._covariance_runs(frame)
        return diagonal[0]

    def covariances(self) -> Array:
        """Diagonal blocks of the inverse at all frames, shape (F, D, D); see `covariance_band`."""
        F, D = self.free.shape
        found = np.empty((F, D, D))
        for start, (diagonal, _, _) in self._covariance_runs():
            found[start : start + len(diagonal)] = diagonal
        return found

    def covariance_band(
        self, begin: int = 0, *, kept: Callable[[Array], Array] = np.asarray
    ) -> tuple[Array, Array, Array]:
        """Blocks of the inverse within the band, of the N frames from `begin` on, in time linear in N; zero where
        unknowns are fixed.

        Parameters
        ----------
        begin : int
        kept : callable
            What to keep of n blocks, (n, D, D) to (n, ...); by default all of them.

        Returns
        -------
        diagonal : ndarray, shape (N, D, D)
        first : ndarray, shape (N - 1, D, D)
            Blocks of frame j + 1 (rows) against frame j (columns).
        second : ndarray, shape (max(N - 2, 0), D, D)
            Blocks of frame j + 2 against frame j.
        """
        runs = [tuple(kept(blocks) for blocks in bands) for _, bands in self._covariance_runs(begin)]
        diagonal, first, second = (np.concatenate(own[::-1]) for own in zip(*runs, strict=True))
        return diagonal, first, second

    def _covariance_runs(self, begin: int = 0) -> Iterator[tuple[int, tuple[Array, ...]]]:
        """Generate the blocks of `covariance_band` run by run, from the last frames to the first, with the first frame
        of each run counted from `begin`: of a long segment, all of them would take much memory.

        Takahashi's recurrence computes them from the last frame to the first, without the blocks outside the band (K.
        Takahashi, J. Fagan, M. Chen, Formation of a sparse bus impedance matrix, 1973).
        """
        free = self.free[begin:]
        N, D = free.shape
        columns = _column_blocks(self._factor, D)[begin:]
        ahead = np.zeros((2 * D, 2 * D))  # the inverse on the next two frames
        for stop in range(N, 0, -FRAMES_AT_ONCE):
            start = max(stop - FRAMES_AT_ONCE, 0)
            bands = _inverse_blocks(columns[start:stop], ahead)
            held = ~free[start : stop + 2]
            for distance, band in enumerate(bands):
                _without_fixed(band, held, distance)
            yield start, tuple(band[: N - k - start] for k, band in enumerate(bands))


def _inverse_blocks(columns: Array, ahead: Array) -> tuple[Array, Array, Array]:
    """Compute the blocks of the inverse on some frames, each against itself and the next two, from the columns (n, 3 D,
    D) of the factor; `ahead`, the inverse on the two frames after them, is replaced by that on the first two of them.
    """
    n, _, D = columns.shape
    inverse = np.stack([dtrtri(block, lower=True)[0] for block in np.tril(columns[:, :D])])
    own, below = np.swapaxes(inverse, 1, 2) @ inverse, columns[:, D:] @ inverse
    found, first, second = np.zeros((3, n, D, D))
    for j in range(n - 1, -1, -1):
        beside = -ahead @ below[j]
        block = own[j] - below[j].T @ beside
        found[j] = (block + block.T) / 2  # asymmetry by rounding would grow from frame to frame
        first[j], second[j] = beside[:D], beside[D:]
        ahead[D:, D:] = ahead[:D, :D]
        ahead[:D, :D], ahead[:D, D:], ahead[D:, :D] = found[j], first[j].T, first[j]
    return found, first, second


def banded(blocks: BandedBlocks, fixed: NDArray[np.bool_], damping: float = 0.0) -> Array:
    """Lower banded storage (3 D, F D) for `scipy.linalg.cholesky_banded`, with identity rows for fixed unknowns."""
    F, D = fixed.shape
    out = np.zeros((3 * D, F * D), order="F")
    columns = _column_blocks(out, D)
    # A ridge above the rounding of the sums keeps the matrix positive definite in directions that nothing measures.
    own = np.einsum("fdd->fd", blocks.diagonal)
    own = np.where(fixed, 1.0, own + (1e-6 * np.maximum(own, 1.0) + damping * own))
    for k, block in enumerate((np.tril(blocks.diagonal), blocks.first, blocks.second)):
        band = columns[: len(block), k * D : (k + 1) * D]
        band[:] = block
        _without_fixed(band, fixed, k)
    d = np.arange(D)
    columns[:, d, d] = own
    return out


def _without_fixed(band: Array, fixed: NDArray[np.bool_], distance: int) -> None:
    """Set rows and columns of fixed unknowns to zero, in place, in the blocks of frames j + distance against j."""
    for j in np.flatnonzero(fixed.any(axis=1)).tolist():
        if j < len(band):
            band[j][:, fixed[j]] = 0.0
        if distance <= j < distance + len(band):
            band[j - distance][fixed[j]] = 0.0


def _column_blocks(stored: Array, D: int) -> Array:
    """Return the blocks in the storage (3 D, F D) of a banded matrix by columns, as a view of shape (F, 3 D, D).

    Each frame has its block against itself, of which only the lower triangle is stored, and those of the next two
    frames against it. The upper triangle shares its memory with entries beyond the band, which are zero.
    """
    height, width = stored.shape
    size = stored.itemsize
    strides = (D * height * size, size, (height - 1) * size)
    return as_strided(stored.T, (width // D, height, D), strides)


def bordered_solution(
    factor: BandedFactor, gradient: Array, border: Array, corner: Array, corner_gradient: Array
) -> tuple[Array, Array]:
    """Solve a banded system with a few further unknowns that couple with every frame, by their Schur complement.

    Parameters
    ----------
    factor : BandedFactor
        Factor of the banded part A.
    gradient : ndarray, shape (F, D)
    border : ndarray, shape (F, D, n)
        B in [[A, B], [B^T, C]].
    corner : ndarray, shape (n, n)
        C.
    corner_gradient : ndarray, shape (n,)

    Returns
    -------
    ndarray, shape (F, D)
    ndarray, shape (n,)
    """
    inner = factor.solve(border)
    alone = factor.solve(gradient)
    n = len(corner)
    seen = np.where(factor.free[..., None], border, 0.0).reshape(-1, n)
    schur = corner - seen.T @ inner.reshape(-1, n)
    outer = np.linalg.solve(schur, corner_gradient - seen.T @ alone.ravel())
    return alone - inner @ outer, outer
