"""Footage is shown without distortion also where the program that shows it has another model for lenses."""

from __future__ import annotations

import numpy as np
import pytest
from kfmocap.core.cameras.brown_conrady import brown_model
from kfmocap.core.cameras.camera import Camera


def lens(distortions, fisheye=False):
    K = [[500, 0, 315.0], [0, 480, 245.0], [0, 0, 1]]
    return Camera.create("cam", (640, 480), K, np.eye(3), np.zeros(3), distortions=distortions, fisheye=fisheye)


def distorted(model, camera, xy):
    """The Brown model written out, pixels."""
    x, y = xy.T
    r2 = x**2 + y**2
    scale = 1 + sum(k * r2 ** (i + 1) for i, k in enumerate(model.radial))
    p1, p2 = model.tangential
    u = x * scale + 2 * p1 * x * y + p2 * (r2 + 2 * x**2)
    v = y * scale + p1 * (r2 + 2 * y**2) + 2 * p2 * x * y
    return np.stack([u, v], 1) * np.diag(camera.matrix)[:2] + camera.matrix[:2, 2]


@pytest.mark.parametrize(
    ("distortions", "fisheye", "within"),
    [
        ((-0.28, 0.09, 0.002, -0.003), False, 1e-9),
        ((-0.28, 0.09, 0.002, -0.003, -0.01), False, 1e-9),
        ((0.2, -0.1, 0.001, 0.002, 0.03, 0.5, -0.15, 0.05), False, 0.05),
        ((0.02, -0.01, 0.004, -0.001), True, 0.2),
    ],
)
def test_any_lens_is_shown_by_a_brown_model(distortions, fisheye, within):
    camera = lens(distortions, fisheye)
    model = brown_model(camera)
    pixels = np.random.default_rng(0).uniform([0, 0], camera.size, (300, 2))
    xy = (pixels - camera.matrix[:2, 2]) / np.diag(camera.matrix)[:2]
    truth = camera.project(np.column_stack([xy, np.ones(300)]))
    seen = ((truth > 0) & (truth < np.array(camera.size) - 1)).all(axis=1)
    apart = np.linalg.norm(distorted(model, camera, xy) - truth, axis=1)[seen]
    assert apart.max() < within and seen.sum() > 100
    assert model.error < within


def test_five_coefficients_come_back_as_they_are():
    model = brown_model(lens((0.1, -0.05, 0.002, -0.003, 0.01)))
    assert model.radial.tolist() == [0.1, -0.05, 0.01, 0.0] and model.tangential.tolist() == [0.002, -0.003]
    assert model.error == 0.0
