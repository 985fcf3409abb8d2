"""The median image is the median of every pixel."""

from __future__ import annotations

import numpy as np
import pytest
from kfmocap.core.numerics.median_image import median_image


@pytest.mark.parametrize("count", [1, 2, 7, 24])
def test_every_pixel_is_the_median_of_its_own(count):
    images = np.random.default_rng(count).integers(0, 256, (count, 9, 7, 3), dtype=np.uint8)
    kept = images.copy()
    found = median_image(list(images))
    assert found.dtype == np.uint8
    np.testing.assert_array_equal(found, np.median(images, axis=0).astype(np.uint8))
    np.testing.assert_array_equal(images, kept)
