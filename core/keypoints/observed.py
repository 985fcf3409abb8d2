"""The keypoints of a shot: read, freed of lens distortion, and given to the performers."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from ..cameras import Camera
from ..evidence.keypoints import Keypoints

Array = NDArray[np.float64]


def image_rays(camera: Camera, pixels: Array) -> Array:
    """Places in the image at a distance of one, (x / z, y / z), of distorted pixels, shape (..., 2); NaN stays NaN."""
    known = np.isfinite(pixels).all(axis=-1)
    out = np.full(pixels.shape, np.nan)
    if known.any():
        undistort = cv2.fisheye.undistortPoints if camera.fisheye else cv2.undistortPoints
        out[known] = undistort(pixels[known][:, None], camera.matrix, camera.distortions)[:, 0]
    return out
