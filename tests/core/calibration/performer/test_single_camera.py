"""One camera comes from a performer who walks on the floor: how high it is, how it is tilted, and what is not known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from keypoint_shots import NAMES, SIZE, seen_places, strolling
from kfmocap.core.body import human
from kfmocap.core.body.motion import Motion
from kfmocap.core.calibration.performer.performer_views import PerformerView
from kfmocap.core.calibration.performer.single_camera import SingleViewCalibration, camera_by_performer
from kfmocap.core.cameras.camera import Camera
from kfmocap.core.errors import CaptureError
from kfmocap.core.shot.detections import Detections
from synthetic import look_at

FRAMES = 90
HEIGHT = 1.75


def walking_in_depth(metres: float = 3.0) -> Motion:
    """A walk towards the camera and past the origin, over so many metres."""
    body = human(HEIGHT)
    motion = strolling(body, FRAMES)
    path = motion.translations.copy()
    path[:, 1] = np.linspace(metres / 2, -metres / 2, FRAMES)
    return Motion(path, motion.rotations)


def view_of(camera: Camera, motion: Motion, *, lens: bool = True, noise: float = 1.0) -> PerformerView:
    rng = np.random.default_rng(1)
    places = seen_places(human(HEIGHT), motion)
    pixels = np.stack([camera.project(points, f) for f, points in enumerate(places)])
    seen = Detections(
        NAMES,
        np.arange(FRAMES),
        pixels + rng.normal(0, noise, pixels.shape),
        np.full(pixels.shape[:2], 0.9),
        np.full(FRAMES, -1),
    )
    return PerformerView(camera.name, camera.size, seen, 0.0, camera if lens else None)


def high_camera(roll: float = 0.0) -> Camera:
    """A camera five metres away and 2.4 m high, which looks down by 16 degrees."""
    camera = look_at("cam01", (0.0, -5.0, 2.4), (0, 0, 0.95), SIZE, 560)
    c, s = np.cos(roll), np.sin(roll)
    turn = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    return replace(camera, R_cam_world=turn @ camera.R_cam_world, t_cam_world=camera.t_cam_world @ turn.T)


def tilt_of_the_world(found: SingleViewCalibration, true: Camera) -> float:
    """Degrees between the up directions, seen from the camera."""
    up, up_true = found.camera.R_cam_world[0, :, 2], true.R_cam_world[0, :, 2]
    return float(np.degrees(np.arccos(up @ up_true)))


def test_who_walks_in_depth_shows_tilt_and_height_of_a_known_lens() -> None:
    true = high_camera()
    found = camera_by_performer(view_of(true, walking_in_depth()), HEIGHT, (0, FRAMES - 1))
    R, t = found.camera.pose(0)
    assert tilt_of_the_world(found, true) < 3.0
    assert (-R.T @ t)[2] == pytest.approx(2.4, abs=0.25)
    assert found.focal_deviation == 0.0
    np.testing.assert_array_equal(found.camera.matrix, true.matrix)


def test_the_origin_is_on_the_floor_below_the_first_hips() -> None:
    true, motion = high_camera(), walking_in_depth()
    found = camera_by_performer(view_of(true, motion), HEIGHT, (0, FRAMES - 1))
    hips = motion.translations[0] * [1, 1, 0]
    pixel, pixel_true = found.camera.project(np.zeros((1, 3)), 0), true.project(hips[None], 0)
    np.testing.assert_allclose(pixel, pixel_true, atol=12)


def test_who_stays_on_one_spot_leaves_the_tilt_open_and_it_is_said_how_much() -> None:
    true = high_camera()
    moving, still = (
        camera_by_performer(view_of(true, walking_in_depth(metres)), HEIGHT, (0, FRAMES - 1)) for metres in (3.0, 0.0)
    )
    assert still.tilt_deviation > 1.5 * moving.tilt_deviation
    assert tilt_of_the_world(still, true) < 3 * np.degrees(still.tilt_deviation)


def test_a_lens_that_is_not_known_is_the_usual_one_and_vague() -> None:
    found = camera_by_performer(view_of(high_camera(), walking_in_depth(), lens=False), HEIGHT, (0, FRAMES - 1))
    assert found.focal_deviation > 0.2
    assert found.camera.matrix[0, 0] == pytest.approx(560, rel=2 * found.focal_deviation)
    assert any("lens is not known" in line for line in found.summary_lines)


def test_a_turned_camera_is_found_from_an_upright_performer_and_said() -> None:
    true = high_camera(roll=0.6)
    found = camera_by_performer(view_of(true, walking_in_depth()), HEIGHT, (0, FRAMES - 1))
    assert tilt_of_the_world(found, true) < 8.0
    assert any("turned by" in line for line in found.summary_lines)


def test_twice_the_height_is_twice_as_far() -> None:
    view = view_of(high_camera(), walking_in_depth())
    # How high cameras usually are does not grow with the performer: so only nearly.
    once, twice = (camera_by_performer(view, h, (0, FRAMES - 1)).camera for h in (HEIGHT, 2 * HEIGHT))
    far, farther = (np.linalg.norm(camera.t_cam_world[0]) for camera in (once, twice))
    assert farther / far == pytest.approx(2.0, rel=0.05)


def test_without_a_limb_it_is_said() -> None:
    view = view_of(high_camera(), walking_in_depth())
    nothing = replace(view, detections=replace(view.detections, points=np.full_like(view.detections.points, np.nan)))
    with pytest.raises(CaptureError, match="no frame shows a limb"):
        camera_by_performer(nothing, HEIGHT, (0, FRAMES - 1))


def test_without_feet_the_floor_is_a_guess_and_said() -> None:
    view = view_of(high_camera(), walking_in_depth())
    points = view.detections.points.copy()
    points[:, [NAMES.index(n) for n in NAMES if "Knee" in n or "Ankle" in n or "Toe" in n or "Heel" in n]] = np.nan
    found = camera_by_performer(replace(view, detections=replace(view.detections, points=points)), HEIGHT, (0, 89))
    assert any("no foot is seen" in line for line in found.summary_lines)
