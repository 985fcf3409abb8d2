"""Banded systems with a few further unknowns."""

from __future__ import annotations

import numpy as np
from kfmocap.core.numerics.banded import BandedFactor, bordered_solution
from kfmocap.core.numerics.banded_blocks import BandedBlocks


def test_the_bordered_solution_is_the_dense_one() -> None:
    rng = np.random.default_rng(0)
    F, D, n = 5, 3, 4
    A = rng.normal(size=(F * D, F * D))
    band = np.abs(np.subtract.outer(np.arange(F * D) // D, np.arange(F * D) // D)) <= 2
    A = (A @ A.T) * band + 60 * np.eye(F * D)
    B, C = rng.normal(size=(F * D, n)), 30 * np.eye(n)
    a, c = rng.normal(size=F * D), rng.normal(size=n)

    def block(i: int, k: int) -> np.ndarray:
        return A[D * (i + k) : D * (i + k + 1), D * i : D * (i + 1)]

    blocks = BandedBlocks(*(np.stack([block(i, k) for i in range(F - k)]) for k in range(3)), a.reshape(F, D), 0.0)
    fixed = np.zeros((F, D), bool)
    fixed[2, 1] = fixed[0] = True
    step, border = bordered_solution(BandedFactor(blocks, fixed), a.reshape(F, D), B.reshape(F, D, n), C, c)
    kept = np.concatenate([~fixed.ravel(), np.ones(n, bool)])
    whole = np.block([[A, B], [B.T, C]])[np.ix_(kept, kept)]
    expected = np.zeros(F * D + n)
    expected[kept] = np.linalg.solve(whole, np.concatenate([a, c])[kept])
    np.testing.assert_allclose(np.concatenate([step.ravel(), border]), expected, atol=1e-5 * np.abs(expected).max())
