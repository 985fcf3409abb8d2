"""Values that roundings do not change."""

from __future__ import annotations

import numpy as np
from kfmocap.core.numerics.repeatable import GRID, on_grid, transformed


def test_roundings_vanish_on_the_grid_and_values_hardly_change() -> None:
    rng = np.random.default_rng(0)
    values = rng.normal(0, 0.1, 10_000)
    kept = on_grid(values)
    assert np.abs(kept - values).max() <= GRID / 2
    same = on_grid(values + rng.normal(0, 1e-13, values.shape)) == kept
    assert same.mean() > 0.9999
    assert np.array_equal(on_grid(kept), kept)


def test_products_of_single_precision_are_summed_in_their_order() -> None:
    rng = np.random.default_rng(1)
    matrices = rng.normal(size=(4, 3, 3)).astype(np.float32)
    points = rng.normal(size=(4, 3, 50)).astype(np.float32)
    a, b, c = (matrices[:, :, k, None] * points[:, None, k] for k in range(3))
    assert np.array_equal(transformed(matrices, points), a + b + c)
    assert transformed(matrices, points).dtype == np.float32
