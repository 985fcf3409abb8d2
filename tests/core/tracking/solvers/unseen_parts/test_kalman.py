"""FilterPy's Kalman filter is loaded alone: tracking does not wait for the statistics that come with the package."""

from __future__ import annotations

import subprocess
import sys

ALONE = """
import sys
import numpy as np
from kfmocap.core.tracking.solvers.unseen_parts import kalman as alone
kalman = alone.KalmanFilter(dim_x=2, dim_z=1)
kalman.F, kalman.H = np.array([[1.0, 1.0], [0.0, 1.0]]), np.array([[1.0, 0.0]])
for y in (1.0, 2.1, 2.9):
    kalman.predict()
    kalman.update(y)
assert "scipy.stats" not in sys.modules
assert not any(name.split(".")[0] == "filterpy" for name in sys.modules)
"""
WHOLE = """
from filterpy.kalman import KalmanFilter, UnscentedKalmanFilter
from filterpy.stats import gaussian
again = KalmanFilter(dim_x=2, dim_z=1)
again.F, again.H = kalman.F, kalman.H
for y in (1.0, 2.1, 2.9):
    again.predict()
    again.update(y)
assert (again.x == kalman.x).all() and (again.P == kalman.P).all()
assert again.log_likelihood == kalman.log_likelihood
assert alone.KalmanFilter is not KalmanFilter  # as it was found first
"""
GIVEN = """
from filterpy.kalman import KalmanFilter
from kfmocap.core.tracking.solvers.unseen_parts import kalman as alone
assert alone.KalmanFilter is KalmanFilter
"""


def run(code: str) -> None:
    subprocess.run([sys.executable, "-c", code], check=True)


def test_the_filter_is_loaded_without_statistics() -> None:
    run(ALONE)


def test_who_imports_filterpy_later_has_all_of_it_and_filters_alike() -> None:
    run(ALONE + WHOLE)


def test_a_package_that_is_loaded_is_used() -> None:
    run(GIVEN)
