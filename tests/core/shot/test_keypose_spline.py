"""The spline through key poses."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest
from kfmocap.core.shot.keypose_spline import natural_spline
from kfmocap.core.shot.rotation_spline import rotation_spline
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation, RotationSpline


@pytest.mark.parametrize("count", [2, 3, 4, 30])
def test_it_is_the_natural_cubic_spline(count: int) -> None:
    rng = np.random.default_rng(count)
    knots = np.cumsum(rng.integers(1, 40, count))
    values, at = rng.normal(size=count), np.arange(knots[0], knots[-1] + 1)
    found = natural_spline(knots, values, at)
    assert np.abs(found - CubicSpline(knots, values, bc_type="natural")(at)).max() < 1e-12
    assert np.abs(found[np.isin(at, knots)] - values).max() < 1e-15


@pytest.mark.parametrize("count", [2, 3, 4, 30])
@pytest.mark.parametrize("turn", [1e-5, 0.1, 1.5])
def test_it_is_scipys_spline_through_rotations(count: int, turn: float) -> None:
    rng = np.random.default_rng(count)
    knots = np.cumsum(rng.integers(1, 40, count))
    steps = Rotation.from_rotvec(turn * rng.normal(size=(count * 5, 3)) / 2).as_matrix().reshape(count, 5, 3, 3)
    values = np.empty_like(steps)
    values[0] = steps[0]
    for k in range(1, count):
        values[k] = values[k - 1] @ steps[k]
    at = np.arange(knots[0], knots[-1] + 1)
    found = rotation_spline(knots, values, at)
    for p in range(5):
        wanted = RotationSpline(knots, Rotation.from_matrix(values[:, p]))(at).as_matrix()
        assert np.abs(found[:, p] - wanted).max() < 1e-13
    assert np.abs(found[np.isin(at, knots)] - values).max() < 1e-12


def test_tracking_does_not_load_scipys_splines() -> None:
    """They take a tenth of a second to load in every process."""
    code = (
        "import sys, numpy as np\n"
        "import kfmocap.cli.track_command\n"
        "from kfmocap.core.shot.keypose_spline import natural_spline\n"
        "natural_spline(np.array([0, 3, 9]), np.arange(3.0), np.arange(10))\n"
        "from kfmocap.core.shot.rotation_spline import rotation_spline\n"
        "rotation_spline(np.array([0, 3, 9]), np.tile(np.eye(3), (3, 2, 1, 1)), np.arange(10))\n"
        "assert 'scipy.interpolate' not in sys.modules"
    )
    subprocess.run([sys.executable, "-c", code], check=True)
