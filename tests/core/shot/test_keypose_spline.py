"""The spline through key poses."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest
from kfmocap.core.shot.keypose_spline import natural_spline
from scipy.interpolate import CubicSpline


@pytest.mark.parametrize("count", [2, 3, 4, 30])
def test_it_is_the_natural_cubic_spline(count: int) -> None:
    rng = np.random.default_rng(count)
    knots = np.cumsum(rng.integers(1, 40, count))
    values, at = rng.normal(size=count), np.arange(knots[0], knots[-1] + 1)
    found = natural_spline(knots, values, at)
    assert np.abs(found - CubicSpline(knots, values, bc_type="natural")(at)).max() < 1e-12
    assert np.abs(found[np.isin(at, knots)] - values).max() < 1e-15


def test_tracking_does_not_load_scipys_splines() -> None:
    """They take a tenth of a second to load in every process."""
    code = (
        "import sys, numpy as np\n"
        "import kfmocap.cli.track_command\n"
        "from kfmocap.core.shot.keypose_spline import natural_spline\n"
        "natural_spline(np.array([0, 3, 9]), np.arange(3.0), np.arange(10))\n"
        "assert 'scipy.interpolate' not in sys.modules"
    )
    subprocess.run([sys.executable, "-c", code], check=True)
