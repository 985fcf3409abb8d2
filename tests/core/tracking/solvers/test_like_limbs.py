"""Left and right limbs that are mistaken for each other."""

from __future__ import annotations

import numpy as np
import pytest
from kfmocap.core.tracking.solvers.limb_corrections.like_limbs import _smoothed
from scipy.ndimage import gaussian_filter1d


@pytest.mark.parametrize("frames", [2, 10, 100])
@pytest.mark.parametrize("sigma", [0.2, 1.5, 6.0])
def test_smoothing_is_scipys(frames: int, sigma: float) -> None:
    values = np.random.default_rng(frames).normal(size=(frames, 9))
    wanted = gaussian_filter1d(values, sigma, axis=0, mode="nearest")
    assert np.abs(_smoothed(values, sigma) - wanted).max() < 1e-15
