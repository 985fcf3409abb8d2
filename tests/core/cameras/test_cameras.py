"""Cameras: projection by hand-made formulas, and reduced, subsampled and rectified pictures that agree with it."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from kfmocap.core.cameras.camera import Camera, reduced_size
from kfmocap.core.errors import CalibrationError
from kfmocap.core.numerics import rotations

SIZE = (640, 480)
K = np.array([[500.0, 0, 310.0], [0, 480.0, 250.0], [0, 0, 1]])
LENS = (-0.2, 0.06, 0.002, -0.003, 0.01)
R = rotations.exp(np.array([1.3, 0.2, -0.4]))
t = np.array([0.3, -0.2, 4.0])


def camera(distortions: tuple[float, ...] = (0, 0, 0, 0), fisheye: bool = False) -> Camera:
    return Camera.create("cam", SIZE, K, R, t, distortions=distortions, fisheye=fisheye)


def cloud(n: int = 200, spread: float = 0.6) -> np.ndarray:
    """Points before the camera and within its picture."""
    rng = np.random.default_rng(0)
    x = rng.uniform(-spread, spread, (n, 3)) * [4, 3, 2] + [0, 0, 4.0]
    x[:, :2] *= x[:, 2:] / 4
    x[:, :2] *= 0.8
    return (x - t) @ R


def by_hand(points: np.ndarray, distortions: tuple[float, ...]) -> np.ndarray:
    k1, k2, p1, p2, k3 = (*distortions, 0.0, 0.0, 0.0, 0.0, 0.0)[:5]
    X = points @ R.T + t
    x, y = X[:, 0] / X[:, 2], X[:, 1] / X[:, 2]
    r2 = x * x + y * y
    radial = 1 + k1 * r2 + k2 * r2**2 + k3 * r2**3
    xd = x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x)
    yd = y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y
    return np.stack([K[0, 0] * xd + K[0, 2], K[1, 1] * yd + K[1, 2]], axis=1)


@pytest.mark.parametrize("distortions", [(0, 0, 0, 0), LENS])
def test_projection_is_the_formula(distortions: tuple[float, ...]) -> None:
    points = cloud()
    np.testing.assert_allclose(camera(distortions).project(points), by_hand(points, distortions), atol=1e-8)


def test_fisheye_projection_is_the_formula() -> None:
    k = np.array([0.05, -0.01, 0.003, -0.001])
    points = cloud()
    X = points @ R.T + t
    r = np.hypot(X[:, 0], X[:, 1])
    theta = np.arctan2(r, X[:, 2])
    bent = theta * (1 + sum(c * theta ** (2 * i + 2) for i, c in enumerate(k)))
    expected = X[:, :2] / r[:, None] * bent[:, None] * [K[0, 0], K[1, 1]] + K[:2, 2]
    np.testing.assert_allclose(camera(tuple(k), fisheye=True).project(points), expected, atol=1e-6)


def test_projection_keeps_leading_axes() -> None:
    points = cloud(24)
    flat = camera(LENS).project(points)
    np.testing.assert_array_equal(camera(LENS).project(points.reshape(2, 3, 4, 3)), flat.reshape(2, 3, 4, 2))


def test_points_behind_the_camera_are_nan_and_others_are_not() -> None:
    cam = camera(LENS)
    points = cloud(4)
    points[1] = 2 * cam.centre_world() - points[1]
    points[3] = cam.centre_world()
    uv = cam.project(points)
    np.testing.assert_array_equal(np.isnan(uv).all(axis=1), [False, True, False, True])
    assert np.isnan(cam.project(points[1])).all()


def test_centre_is_where_every_ray_begins() -> None:
    np.testing.assert_allclose(R @ camera().centre_world() + t, 0, atol=1e-12)


def test_moving_camera_has_a_pose_per_frame_and_stays_at_its_last() -> None:
    shifts = np.array([[0.0, 0, 4], [1, 0, 4], [2, 0, 4]])
    cam = Camera.create("cam", SIZE, K, np.stack([R] * 3), shifts)
    assert cam.moving and not camera().moving
    assert not cam.stands_still and camera().stands_still
    assert Camera.create("cam", SIZE, K, np.stack([R] * 3), [t] * 3).stands_still
    point = cloud(1)[0]
    for f in range(3):
        fixed = Camera.create("cam", SIZE, K, R, shifts[f])
        np.testing.assert_array_equal(cam.project(point, f), fixed.project(point))
        np.testing.assert_array_equal(cam.centre_world(f), fixed.centre_world())
    np.testing.assert_array_equal(cam.project(point, 7), cam.project(point, 2))
    poses = cam.poses(1, 4)
    np.testing.assert_array_equal(poses[1], shifts[[1, 2, 2, 2]])
    assert poses[0].shape == (4, 3, 3)
    np.testing.assert_array_equal(camera().poses(5, 2)[1], [t, t])


@given(st.floats(1, 9))
def test_reduced_camera_keeps_pixel_centres(factor: float) -> None:
    """A pixel's corners u - 1/2 and u + 1/2 scale with the picture."""
    small = camera(LENS).reduced(factor)
    scale = np.array(small.size) / SIZE
    assert small.size == reduced_size(SIZE, factor)
    points = cloud()
    np.testing.assert_allclose(
        small.project(points) + 0.5, (camera(LENS).project(points) + 0.5) * scale, rtol=0, atol=1e-8
    )


@given(st.integers(1, 7))
def test_subsampled_camera_counts_every_nth_pixel(stride: int) -> None:
    cam = camera().subsampled(stride)
    assert cam.size == (len(range(0, SIZE[0], stride)), len(range(0, SIZE[1], stride)))
    np.testing.assert_allclose(cam.project(cloud()) * stride, camera().project(cloud()), atol=1e-9)


@given(st.integers(0, 1), st.integers(2, 9))
def test_a_fields_camera_has_the_lines_of_one_parity(parity: int, height: int) -> None:
    points, lines = cloud(), list(range(height))[parity::2]
    for cam in (camera(LENS), camera((0.05, -0.01, 0.003, -0.001), fisheye=True)):
        assert replace(cam, size=(640, height)).field(parity).size == (640, len(lines))
        uv = cam.field(parity).project(points)
        np.testing.assert_allclose(uv * [1, 2] + [0, parity], cam.project(points), atol=1e-8)


def blob(size: tuple[int, int], uv: np.ndarray, sigma: float) -> np.ndarray:
    v, u = np.indices((size[1], size[0]))
    d2 = (u - uv[0]) ** 2 + (v - uv[1]) ** 2
    return np.exp(-d2 / (2 * sigma**2)).astype(np.float32)


def centroid(image: np.ndarray) -> np.ndarray:
    v, u = np.indices(image.shape)
    return np.array([(u * image).sum(), (v * image).sum()]) / image.sum()


@pytest.mark.parametrize(("distortions", "fisheye"), [(LENS, False), ((0.05, -0.01, 0.003, -0.001), True)])
def test_a_point_filmed_is_found_where_the_reduced_rectified_camera_projects_it(
    distortions: tuple[float, ...], fisheye: bool
) -> None:
    cam = camera(distortions, fisheye)
    small = cam.reduced(4)
    maps = small.rectify_maps()
    assert maps is not None
    for point in cloud(12, 0.35):
        filmed = blob(SIZE, cam.project(point), 6.0)
        reduced = cv2.resize(filmed, small.size, interpolation=cv2.INTER_AREA)
        seen = cv2.remap(reduced, *maps, cv2.INTER_LINEAR)
        # A lens of some percent spreads the blob unevenly; rectify_maps rounds to 1/32 pixel.
        np.testing.assert_allclose(centroid(seen), small.rectified().project(point), atol=0.08)


def test_rectified_is_a_pinhole_and_needs_no_maps() -> None:
    points = cloud()
    np.testing.assert_allclose(camera(LENS).rectified().project(points), by_hand(points, (0, 0, 0, 0)), atol=1e-8)
    assert camera(LENS).rectified().rectify_maps() is None
    assert camera().rectify_maps() is None
    assert camera((0, 0, 0, 0), fisheye=True).rectify_maps() is not None


def test_a_camera_of_some_frames_counts_these_from_zero() -> None:
    turns = np.stack([cv2.Rodrigues(np.array([0, 0.1 * f, 0]))[0] for f in range(6)])
    moving = Camera.create("cam", SIZE, K, turns, np.arange(18.0).reshape(6, 3))
    some = moving.at([5, 2])
    for k, frame in enumerate((5, 2)):
        for a, b in zip(some.pose(k), moving.pose(frame), strict=True):
            np.testing.assert_array_equal(a, b)
    assert not camera().at([5, 2]).moving


def test_no_picture_is_reduced_to_nothing() -> None:
    assert reduced_size((30, 2), 100) == (1, 1)


@pytest.mark.parametrize(
    "change",
    [
        {"matrix": np.eye(2)},
        {"matrix": np.diag([-500.0, 500, 1])},
        {"matrix": np.diag([500.0, 0, 1])},
        {"matrix": np.diag([500.0, np.nan, 1])},
        {"R_cam_world": np.stack([R, R])},
        {"R_cam_world": rotations.log(R)},
        {"R_cam_world": 1.01 * R},
        {"R_cam_world": -R},
        {"t_cam_world": [0, 0]},
        {"size": "640x480"},
        {"size": (480, 640, 3)},
        {"size": 640},
        {"size": (640, 0)},
        {"size": (640, np.nan)},
        {"size": ("640", "480")},
        {"matrix": K.T},
        {"R_cam_world": np.zeros((0, 3, 3)), "t_cam_world": np.zeros((0, 3))},
        {"t_cam_world": [0, 0, np.inf]},
        {"distortions": [np.nan, 0, 0, 0]},
    ],
)
def test_bad_calibrations_are_refused_by_the_cameras_name(change: dict) -> None:
    good = {"name": "cam07", "size": SIZE, "matrix": K, "R_cam_world": R, "t_cam_world": t}
    with pytest.raises(CalibrationError, match="cam07"):
        Camera.create(**(good | change))
