"""The curve through key poses."""

from __future__ import annotations

import numpy as np
import pytest
from kfmocap.core.shot.keypose_spline import natural_spline
from scipy.interpolate import CubicSpline


@pytest.mark.parametrize("count", [2, 3, 4, 9])
def test_the_natural_spline_is_that_of_scipy(count: int) -> None:
    random = np.random.default_rng(count)
    knots, values = np.cumsum(random.integers(1, 30, count)), random.normal(size=count)
    places = np.arange(knots[0], knots[-1] + 1)
    expected = CubicSpline(knots, values, bc_type="natural")(places)
    np.testing.assert_allclose(natural_spline(knots, values, places), expected, atol=1e-12)
