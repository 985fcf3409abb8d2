"""From rendered pinhole images to what a camera records: lens distortion, sensor noise; needs no Blender."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
from kfmocap.core.cameras.camera import Camera
from numpy.typing import NDArray

NOISE = 1.2
"""Standard deviation of the sensor noise, grey levels of 255."""


def padded_pinhole(camera: Camera) -> Camera:
    """The same camera without distortion, its picture padded to cover everything that the lens sees."""
    if not camera.distortions.any():
        return camera
    width, height = camera.size
    edge = np.array([[u, v] for u in np.linspace(0, width - 1, 9) for v in np.linspace(0, height - 1, 9)])
    seen = cv2.undistortPoints(edge[:, None], camera.matrix, camera.distortions, P=camera.matrix)[:, 0]
    over = np.maximum(-seen.min(axis=0), seen.max(axis=0) - [width - 1, height - 1])
    pad = np.maximum(np.ceil(over).astype(int) + 3, 0)
    matrix = camera.matrix.copy()
    matrix[:2, 2] += pad
    size = (int(width + 2 * pad[0]), int(height + 2 * pad[1]))
    return replace(camera, size=size, matrix=matrix, distortions=np.zeros(4))


def through_lens(image: NDArray[np.uint8], pinhole: Camera, camera: Camera) -> NDArray[np.uint8]:
    """Distort an image of `padded_pinhole(camera)` into what the camera records."""
    if not camera.distortions.any():
        return image
    width, height = camera.size
    grid = np.stack(np.meshgrid(np.arange(width), np.arange(height)), axis=-1).astype(float)
    source = cv2.undistortPoints(grid.reshape(-1, 1, 2), camera.matrix, camera.distortions, P=pinhole.matrix)
    u, v = source.reshape(height, width, 2).astype(np.float32).transpose(2, 0, 1)
    return cv2.remap(image, u, v, cv2.INTER_LANCZOS4)


def with_noise(image: NDArray[np.uint8], seed: list[int]) -> NDArray[np.uint8]:
    """Add Gaussian sensor noise to an image."""
    noise = np.random.default_rng(seed).normal(0, NOISE, image.shape)
    return np.clip(image + noise, 0, 255).round().astype(np.uint8)
