"""Pictures around a point tell whether it stands or moves as it was tracked."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest
from kfmocap.core.cameras.camera import Camera
from kfmocap.core.evidence.standing_points import log_gain_by_displacement, log_odds_of_standing
from kfmocap.core.evidence.view_frames import ViewFrames
from synthetic import CENTRE, look_at

Array = np.ndarray
FRAMES, CLEAR = 12, np.log(10.0)
CAMERA = look_at("front", (0.5, -2.8, 1.5), size=(320, 240), focal=500)
DRIFT = np.array(CENTRE) + np.linspace(-0.01, 0.01, FRAMES)[:, None] * [1.0, 0.0, 0.0]
STILL = np.repeat(DRIFT.mean(axis=0)[None], FRAMES, axis=0)


def pictures(places: Array, camera: Camera = CAMERA, contrast: float = 30.0) -> ViewFrames:
    """A texture that moves with a point, and noise of one grey level."""
    dice = np.random.default_rng(1)
    texture = cv2.GaussianBlur(dice.normal(0, 1, (300, 400)).astype(np.float32), (0, 0), 1.5)
    texture = 120 + contrast * texture / texture.std()
    start = camera.project(places[:1])[0]
    shown = []
    for f, place in enumerate(places):
        shift = camera.project(place[None], f)[0] - start
        moved = cv2.warpAffine(
            texture, np.array([[1, 0, shift[0] - 40], [0, 1, shift[1] - 30]], float), (320, 240), flags=cv2.INTER_CUBIC
        )
        shown.append(np.clip(moved + dice.normal(0, 1, moved.shape), 0, 255).astype(np.uint8))
    return ViewFrames(camera, np.array(shown), 5)


@pytest.mark.parametrize("contrast", [8.0, 30.0])
def test_pictures_that_stay_show_that_the_point_stands_and_those_that_move_that_it_moves(contrast: float) -> None:
    """It was tracked with a drift of 2 cm."""
    assert log_odds_of_standing(pictures(STILL, contrast=contrast), 5, DRIFT) > CLEAR
    assert log_odds_of_standing(pictures(DRIFT, contrast=contrast), 5, DRIFT) < -CLEAR


def test_nothing_is_said_of_what_has_no_texture_or_is_not_in_the_picture() -> None:
    plain = replace(pictures(STILL), grey=np.full((FRAMES, 240, 320), 90, np.uint8))
    assert log_odds_of_standing(plain, 5, DRIFT) == pytest.approx(0, abs=1e-6)
    for beside in ([3.0, 0.0, 0.0], [0.0, -9.0, 0.0]):  # and behind the camera
        assert log_odds_of_standing(pictures(STILL), 5, DRIFT + beside) == 0.0


def test_a_shadow_that_passes_does_not_make_a_standing_point_move() -> None:
    view = pictures(STILL)
    view.grey[4:7] //= 2
    assert log_odds_of_standing(view, 5, DRIFT) > CLEAR


def test_damaged_frames_are_left_out() -> None:
    view = pictures(DRIFT)
    said = log_odds_of_standing(view, 5, DRIFT)
    view.grey[[3, 8]] = 0
    damaged = np.isin(np.arange(FRAMES), [3, 8])
    assert abs(log_odds_of_standing(replace(view, damaged=damaged), 5, DRIFT) - said) < 0.3 * abs(said)
    assert log_odds_of_standing(replace(view, damaged=np.ones(FRAMES, bool)), 5, DRIFT) == 0.0


def test_the_surroundings_follow_the_pose_of_a_moving_camera() -> None:
    eyes = np.array([0.5, -2.8, 1.5]) + np.linspace(0, 0.1, FRAMES)[:, None] * [1.0, 0.0, 0.0]
    each = [look_at("pan", eye, size=(320, 240), focal=500) for eye in eyes]
    R = np.concatenate([camera.R_cam_world for camera in each])
    t = np.concatenate([camera.t_cam_world for camera in each])
    pan = replace(CAMERA, R_cam_world=R, t_cam_world=t)
    assert pan.moving
    late = replace(pictures(STILL, pan), first=0)
    assert log_odds_of_standing(late, 0, DRIFT) > CLEAR


STOOD = np.arange(FRAMES) < 8


@pytest.mark.parametrize("focal", [500, 2000])
def test_pictures_of_single_frames_show_whether_a_point_that_stood_has_been_displaced(focal: int) -> None:
    """On the last four frames, by 6 mm: a pixel, or four in finer pictures."""
    camera = replace(CAMERA, matrix=CAMERA.matrix * [[focal / 500], [focal / 500], [1.0]])
    camera.matrix[:2, 2] = CAMERA.matrix[:2, 2]
    displaced = STILL + np.where(STOOD, 0.0, 0.006)[:, None] * [1.0, 0.0, 0.0]
    place = STILL[0]
    still, moved = (log_gain_by_displacement(pictures(p, camera), 5, place, STOOD) for p in (STILL, displaced))
    assert still[~STOOD].max() < 0.7 and moved[~STOOD].min() > 2.0


def test_frames_that_are_damaged_and_points_beside_the_picture_show_no_displacement() -> None:
    view, damaged = pictures(STILL), np.arange(FRAMES) == 9
    gains = log_gain_by_displacement(replace(view, damaged=damaged), 5, STILL[0], STOOD)
    np.testing.assert_array_equal(np.isnan(gains), damaged)
    beside = log_gain_by_displacement(view, 5, STILL[0] + [3.0, 0.0, 0.0], STOOD)
    np.testing.assert_array_equal(np.isnan(beside), ~STOOD)
