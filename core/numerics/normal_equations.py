"""Normal equations of nonlinear least squares: their interface, and dense, banded and sparse storage.

With whitened residuals r, their Jacobian J and robust weights W, H = J^T W J is the Gauss-Newton matrix, g = J^T W r
the gradient of half the cost, and the cost is the sum of rho(|r|^2). A step is -(H + damping * diag(H))^-1 g.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Generic, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.linalg import cho_factor, cho_solve
from scipy.sparse.linalg import splu

from .arrays import Array
from .banded import BandedFactor
from .banded_blocks import BandedBlocks

Step_co = TypeVar("Step_co", covariant=True)
Factor_co = TypeVar("Factor_co", covariant=True)
MatrixFactor = TypeVar("MatrixFactor", "DenseFactor", "SparseFactor")

DIAGONAL_FLOOR = 1e-9
"""Lower bound of the diagonal in the damping, as a share of its largest element, for unknowns that nothing measures."""


class NormalEquations(Protocol[Step_co, Factor_co]):
    """Gauss-Newton's linear system at one state."""

    @property
    def cost(self) -> float:
        """Robust sum of squared residuals."""
        ...

    def solve(self, damping: float) -> Step_co:
        """Levenberg-Marquardt step; raises numpy's `LinAlgError` if the damped matrix is not positive definite."""
        ...

    def slope(self, step: Any) -> float:
        """Derivative of the cost along a step, 2 g^T step."""
        ...

    def factor(self) -> Factor_co:
        """Factorisation of the undamped matrix, whose inverse is the covariance of the unknowns."""
        ...


def _damped_diagonal(diagonal: Array, damping: float) -> Array:
    return damping * np.maximum(diagonal, DIAGONAL_FLOOR * diagonal.max(initial=0.0))


class _MatrixEquations(Generic[MatrixFactor]):
    """Normal equations that store their matrix as a single array."""

    gradient: Array

    def _factor(self, damping: float) -> MatrixFactor:
        """Factor of the damped matrix."""
        raise NotImplementedError

    def solve(self, damping: float) -> Array:
        """Damped step, shape (n,); see `NormalEquations`."""
        return -self._factor(damping).solve(self.gradient)

    def slope(self, step: Array) -> float:
        """Derivative of the cost along a step (n,)."""
        return 2 * float(self.gradient @ step)

    def factor(self) -> MatrixFactor:
        """Factor of the undamped matrix."""
        return self._factor(0.0)


@dataclass(frozen=True, eq=False)
class DenseFactor:
    """Cholesky factor of a dense matrix, as `scipy.linalg.cho_factor` gives it."""

    cholesky: tuple[Array, bool]

    def solve(self, right: Array) -> Array:
        """Solve for right-hand sides (n,) or (n, k)."""
        return np.asarray(cho_solve(self.cholesky, right, check_finite=False))

    def covariance(self) -> Array:
        """Inverse of the matrix, shape (n, n)."""
        return self.solve(np.eye(len(self.cholesky[0])))


@dataclass(frozen=True, eq=False)
class DenseEquations(_MatrixEquations[DenseFactor]):
    """Normal equations of a small number of unknowns.

    Attributes
    ----------
    matrix : ndarray, shape (n, n)
    gradient : ndarray, shape (n,)
        Of half the cost.
    cost : float
    """

    matrix: Array
    gradient: Array
    cost: float

    def _factor(self, damping: float) -> DenseFactor:
        diagonal = _damped_diagonal(self.matrix.diagonal(), damping)
        return DenseFactor(cho_factor(self.matrix + np.diag(diagonal), lower=True, check_finite=False))


@dataclass(frozen=True, eq=False)
class BandedEquations:
    """Normal equations over F frames of D unknowns each, block-pentadiagonal.

    Attributes
    ----------
    blocks : BandedBlocks
    fixed : ndarray of bool, shape (F, D)
        Unknowns that do not move.
    """

    blocks: BandedBlocks
    fixed: NDArray[np.bool_]

    @property
    def cost(self) -> float:
        """Robust sum of squared residuals."""
        return self.blocks.energy

    def solve(self, damping: float) -> Array:
        """Damped step, shape (F, D), zero where fixed; see `NormalEquations`."""
        return -BandedFactor(self.blocks, self.fixed, damping).solve(self.blocks.gradient)

    def slope(self, step: Array) -> float:
        """Derivative of the cost along a step (F, D)."""
        return 2 * float(np.sum(self.blocks.gradient * step))

    def factor(self) -> BandedFactor:
        """Cholesky factor of the undamped matrix."""
        return BandedFactor(self.blocks, self.fixed)


@dataclass(frozen=True, eq=False)
class SparseFactor:
    """Factorisation of a sparse symmetric positive definite matrix in the order of its unknowns."""

    decomposition: Any  # scipy.sparse.linalg.SuperLU has no public name

    @classmethod
    def create(cls, matrix: sparse.csc_array) -> SparseFactor:
        """Factorise without pivoting: for a band whose border comes last, no other order has less fill-in."""
        try:
            decomposition = splu(matrix, permc_spec="NATURAL", diag_pivot_thresh=0.0, options={"SymmetricMode": True})
        except RuntimeError as error:  # SuperLU's word for a singular matrix
            raise np.linalg.LinAlgError(str(error)) from error
        return cls(decomposition)

    def solve(self, right: Array) -> Array:
        """Solve for right-hand sides (n,) or (n, k)."""
        return np.asarray(self.decomposition.solve(right))


@dataclass(frozen=True, eq=False)
class SparseEquations(_MatrixEquations[SparseFactor]):
    """Normal equations with a sparse matrix, whose unknowns are in an order with little fill-in.

    Attributes
    ----------
    matrix : sparse array, shape (n, n)
    gradient : ndarray, shape (n,)
        Of half the cost.
    cost : float
    """

    matrix: sparse.csc_array
    gradient: Array
    cost: float

    def _factor(self, damping: float) -> SparseFactor:
        diagonal = _damped_diagonal(self.matrix.diagonal(), damping)
        return SparseFactor.create(self.matrix + sparse.diags_array(diagonal, format="csc"))


@dataclass(frozen=True, eq=False)
class IndependentEquations:
    """Several systems without common unknowns, solved with the same damping: one per performer, for example.

    Attributes
    ----------
    parts : sequence of NormalEquations
        Their costs add up; a step is the list of their steps.
    """

    parts: Sequence[NormalEquations[Any, Any]]

    @property
    def cost(self) -> float:
        """Sum of the parts' costs."""
        return sum(part.cost for part in self.parts)

    def solve(self, damping: float) -> list[Any]:
        """Damped step of every part."""
        return [part.solve(damping) for part in self.parts]

    def slope(self, step: Sequence[Any]) -> float:
        """Derivative of the cost along the parts' steps."""
        return sum(part.slope(own) for part, own in zip(self.parts, step, strict=True))

    def factor(self) -> list[Any]:
        """Factor of every part."""
        return [part.factor() for part in self.parts]
