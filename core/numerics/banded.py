"""Block-banded systems over the frames of a segment, degrees of freedom fixed one by one."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_solve_banded, cholesky_banded

from .arrays import Array
from .banded_blocks import BandedBlocks


class BandedFactor:
    """Cholesky factor of a block-banded matrix with some unknowns taken out.

    Parameters
    ----------
    blocks : BandedBlocks
        F frames of D degrees of freedom.
    fixed : ndarray of bool, shape (F, D)
        Unknowns that do not move: their rows and columns are taken out.
    damping : float
        Levenberg's: this share of the diagonal is added to it.
    """

    def __init__(self, blocks: BandedBlocks, fixed: NDArray[np.bool_], damping: float = 0.0) -> None:
        self.free = ~fixed
        self._factor = cholesky_banded(banded(blocks, fixed, damping), lower=True, check_finite=False)

    def solve(self, right: Array) -> Array:
        """Solve for a right-hand side of shape (F, D) or (F, D, n); fixed unknowns come out zero."""
        free = self.free.reshape(self.free.shape + (1,) * (right.ndim - 2))
        masked = np.where(free, right, 0.0).reshape(self.free.size, *right.shape[2:])
        return cho_solve_banded((self._factor, True), masked, check_finite=False).reshape(right.shape)

    def log_determinant(self) -> float:
        """Logarithm of the determinant of the matrix of the free unknowns."""
        return float(2 * np.log(self._factor[0]).sum())

    def covariance(self, frame: int) -> Array:
        """Block of the inverse at one frame, shape (D, D): the uncertainty of that pose."""
        return self.column(frame)[frame]

    def column(self, frame: int) -> Array:
        """Blocks of the inverse between every frame and one, shape (F, D, D): how poses go with that one."""
        F, D = self.free.shape
        unit = np.zeros((F, D, D))
        unit[frame] = np.eye(D)
        return self.solve(unit)

    def covariances(self) -> Array:
        """Blocks of the inverse at all frames, shape (F, D, D); see `covariance_band`."""
        return self.covariance_band()[0]

    def covariance_band(self) -> tuple[Array, Array, Array]:
        """Blocks of the inverse within the band, in time linear in F; zero where unknowns are fixed.

        By Takahashi's recurrence, from the last frame to the first: of the inverse only the blocks within the band are
        formed (K. Takahashi, J. Fagan, M. Chen, Formation of a sparse bus impedance matrix, 1973).

        Returns
        -------
        diagonal : ndarray, shape (F, D, D)
        first : ndarray, shape (F - 1, D, D)
            Each frame's next frame (rows) against it (columns).
        second : ndarray, shape (max(F - 2, 0), D, D)
            Each frame's next frame but one against it.
        """
        F, D = self.free.shape
        diagonal, below = self._factor_blocks()
        inverse = np.linalg.inv(diagonal)
        found, first, second = np.zeros((3, F, D, D))
        ahead = np.zeros((2 * D, 2 * D))  # the inverse on the next two frames
        for j in range(F - 1, -1, -1):
            G = below[j] @ inverse[j]
            beside = -ahead @ G
            block = inverse[j].T @ inverse[j] - G.T @ beside
            found[j] = (block + block.T) / 2  # what is not symmetric in the rounding would grow from frame to frame
            first[j], second[j] = beside[:D], beside[D:]
            ahead = np.block([[found[j], beside[:D].T], [beside[:D], ahead[:D, :D]]])
        free = self.free.astype(float)
        rows, columns = free[:, :, None], free[:, None, :]
        return (
            found * rows * columns,
            first[:-1] * rows[1:] * columns[:-1],
            second[: max(F - 2, 0)] * rows[2:] * columns[: max(F - 2, 0)],
        )

    def _factor_blocks(self) -> tuple[Array, Array]:
        """The factor's blocks of each frame: the diagonal (F, D, D), and those of the next two frames, (F, 2 D, D)."""
        F, D = self.free.shape
        stored = self._factor.reshape(3 * D, F, D)
        rows, columns = np.indices((3 * D, D))
        within = rows >= columns
        blocks = np.zeros((F, 3 * D, D))
        blocks[:, rows[within], columns[within]] = stored[(rows - columns)[within], :, columns[within]].T
        return blocks[:, :D], blocks[:, D:]


def banded(blocks: BandedBlocks, fixed: NDArray[np.bool_], damping: float = 0.0) -> Array:
    """Lower banded storage (3 D, F D) as `scipy.linalg.cholesky_banded` takes it; fixed unknowns become identity."""
    F, D = fixed.shape
    free = (~fixed).astype(float)
    out = np.zeros((3 * D, F, D))
    rows, columns = np.indices((D, D))
    lower = rows >= columns
    diagonal = blocks.diagonal * free[:, :, None] * free[:, None, :]
    # Directions that nothing measures keep the matrix positive definite by a ridge above the rounding of the sums.
    ridge = 1e-6 * np.maximum(np.einsum("fdd->fd", blocks.diagonal), 1.0)
    d = np.arange(D)
    diagonal[:, d, d] += np.where(fixed, 1.0, ridge + damping * np.einsum("fdd->fd", diagonal))
    out[(rows - columns)[lower], :, columns[lower]] = diagonal[:, rows[lower], columns[lower]].T
    for k, block in ((1, blocks.first), (2, blocks.second)):
        n = len(block)
        if n:
            kept = block * free[k:, :, None] * free[:n, None, :]
            out[(k * D + rows - columns).ravel(), :n, columns.ravel()] = kept.reshape(n, -1).T
    return out.reshape(3 * D, F * D)


def bordered_solution(
    factor: BandedFactor, gradient: Array, border: Array, corner: Array, corner_gradient: Array
) -> tuple[Array, Array]:
    """Solve a banded system with a few more unknowns that touch every frame, by their Schur complement.

    Parameters
    ----------
    factor : BandedFactor
        Of the banded part A.
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
