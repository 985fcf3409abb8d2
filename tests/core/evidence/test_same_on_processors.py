"""The images that the evidence is taken from do not depend on the instructions that a processor has."""

from __future__ import annotations

import os
import subprocess
import sys
from itertools import pairwise

import numpy as np
import pytest
from kfmocap.core.evidence.smoothed_images import SmoothedImages
from scipy.ndimage import gaussian_filter

OLDER = {
    "as it is": {},
    "no AVX2": {"OPENCV_CPU_DISABLE": "AVX2,FMA3,AVX", "NPY_DISABLE_CPU_FEATURES": "AVX2 FMA3"},
    "no SSE4.2 nor IPP": {"OPENCV_CPU_DISABLE": "AVX2,FMA3,AVX,SSE4.2", "OPENCV_IPP": "disabled"},
}
CODE = """
import hashlib, numpy as np
from kfmocap.core.evidence.foreground_images.foreground import _histogram
from kfmocap.core.evidence.smoothed_images import SmoothedImages
rng = np.random.default_rng(0)
sha = hashlib.sha256()
for sigma in (1.0, 1.7, 4.0, 8.0):
    sha.update(SmoothedImages.with_gradients(rng.integers(0, 256, (1, 61, 83), dtype=np.uint8), sigma).values.tobytes())
colour = rng.integers(0, 256, (1, 61, 83, 3), dtype=np.uint8)
sha.update(_histogram(colour, {0: colour[0, ..., 0] > 99}).tobytes())
print(sha.hexdigest())
"""


@pytest.mark.skipif(sys.platform != "linux", reason="these are the names of the instructions of one kind of processor")
def test_images_are_the_same_to_the_last_bit_without_newer_instructions() -> None:
    running = [
        subprocess.Popen([sys.executable, "-c", CODE], env=os.environ | off, stdout=subprocess.PIPE, text=True)
        for off in OLDER.values()
    ]
    found = [process.communicate()[0].strip() for process in running]
    assert all(found)
    assert all(a == b for a, b in pairwise(found))


@pytest.mark.parametrize("sigma", [1.0, 4.0, 8.0])
def test_images_are_smoothed_by_a_gaussian(sigma: float) -> None:
    image = np.random.default_rng(1).integers(0, 256, (1, 120, 160), dtype=np.uint8)
    values = SmoothedImages.with_gradients(image, sigma).values
    smooth = gaussian_filter(image[0] / 255, sigma, mode="mirror", truncate=4)
    assert values[..., 0] == pytest.approx(smooth, abs=1e-3)
    slope = gaussian_filter(np.gradient(image[0] / 255.0, axis=1), sigma, mode="mirror", truncate=4)
    inner = slice(40, -40), slice(40, -40)
    assert values[..., 1][inner] == pytest.approx(slope[inner], abs=0.03 / sigma**2)
    assert values[..., 0].max() <= 1
