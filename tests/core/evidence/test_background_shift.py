"""A camera that moves though its calibration has one pose is told by the background, whatever else moves."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest
from kfmocap.core.cameras.lens_turns import zooming
from kfmocap.core.evidence.background_shift import BackgroundShift, background_shift
from kfmocap.core.fitting.checks.background_checks import followed_cameras
from kfmocap.core.fitting.checks.early_check import early_misfits
from kfmocap.core.fitting.checks.view_findings import MovedCamera, PlainBackground
from kfmocap.core.fitting.shot_cameras import camera_fits, fit_by_key_poses
from kfmocap.core.keypoints.observations import ShotKeypoints
from kfmocap.core.shot.settings import Settings
from kfmocap.core.shot.shot import View
from kfmocap.core.tracking.scheduling.run_context import SolvedShot
from scipy.spatial.transform import Rotation
from synthetic import figure, look_at, shot_of, swing

SIZE = (320, 240)
BODY = figure()
TRUTH = swing(BODY, 13, size=0.9)[::4]
FRONT = look_at("front", (0.5, -2.8, 1.5))


def wall(size: tuple[int, int] = SIZE) -> np.ndarray:
    rough = np.random.default_rng(3).uniform(0, 255, (size[1], size[0], 3))
    return cv2.normalize(cv2.GaussianBlur(rough, (0, 0), 2.0), None, 0, 255, cv2.NORM_MINMAX).astype(np.uint8)


def moved(picture: np.ndarray, x: float, y: float, degrees: float = 0.0, larger: float = 1.0) -> np.ndarray:
    h, w = picture.shape[:2]
    turn = cv2.getRotationMatrix2D((w / 2, h / 2), degrees, larger)
    turn[:, 2] += x, y
    return cv2.warpAffine(picture, turn, (w, h), borderMode=cv2.BORDER_REFLECT)


def shift_of(*pictures: np.ndarray, factor: float = 1.0):
    nobody = [np.zeros(picture.shape[:2], bool) for picture in pictures]
    return background_shift(pictures, nobody, [10 * k for k in range(len(pictures))], factor)


def test_the_largest_shift_is_named_in_pixels_of_the_footage() -> None:
    found = shift_of(wall(), moved(wall(), 3, 0), moved(wall(), 12, -9, 1.0), moved(wall(), 0, 5), factor=2.0)
    assert found is not None
    assert found.frames == (0, 20)
    assert found.pixels == pytest.approx(30.0, abs=2.0)


@pytest.mark.parametrize("light", [1.0, 0.5])
def test_a_camera_stands_still_though_something_large_moves(light: float) -> None:
    passing = wall()
    passing[:, :140] = moved(wall(), 15, 4)[:, :140]  # a curtain, or somebody who passes
    assert shift_of(wall(), (light * passing).astype(np.uint8), wall()) is None


def test_a_plain_wall_and_other_footage_tell_nothing() -> None:
    plain = np.full((240, 320, 3), 120, np.uint8)
    assert shift_of(plain, plain) is None
    assert shift_of(wall(), wall()[::-1, ::-1].copy()) is None


def test_where_performers_are_does_not_count() -> None:
    """They fill all but a strip of the picture, and turn the same way."""
    here = np.zeros((240, 320), bool)
    here[:, :250] = True
    turning = wall()
    turning[:, :250] = moved(wall(), 6, 0)[:, :250]
    assert background_shift([wall(), turning], [here, here], [0, 5], 1.0) is None


def test_a_camera_that_was_moved_is_said_to_have_moved_also_before_tracking() -> None:
    shot = shot_of([View(FRONT, "front.mp4")], [BODY], [TRUTH], range(len(TRUTH)))
    shot = replace(shot, frames=(100, 100 + len(TRUTH) - 1))
    still = wall(FRONT.size)
    pictures = [{k: moved(still, 4 * k, 0) for k in range(len(TRUTH))}]
    [said] = fit_by_key_poses(shot, pictures)
    as_it_is = replace(shot, settings=Settings(stabilise=False))
    assert [own.by for own in early_misfits(as_it_is, pictures)] == ["background"]
    assert not early_misfits(shot, pictures)  # how it moves is measured, and told in the end
    assert isinstance(said, MovedCamera) and said.off
    last = 100 + len(TRUTH) - 1
    assert f"front: its camera moved: the background lies 12 px elsewhere on frame {last} than on frame 100" in (
        said.summary
    )
    assert "vidstabtransform=tripod=1" in said.summary and "the background shifts by 12 px" in said.brief


@pytest.mark.parametrize("larger", [1.2, 0.9])
def test_a_camera_that_zooms_is_said_to_zoom_and_not_to_be_stabilised(larger: float) -> None:
    shot = shot_of([View(FRONT, "front.mp4")], [BODY], [TRUTH], range(len(TRUTH)))
    still, count = wall(FRONT.size), len(TRUTH)
    pictures = [{k: moved(still, 0, 0, larger=larger ** (k / (count - 1))) for k in range(count)}]
    [said] = fit_by_key_poses(shot, pictures)
    assert isinstance(said, MovedCamera) and said.background.enlarged == pytest.approx(larger, abs=0.01)
    assert f"{said.background.enlarged:.0%} of its size" in said.summary and "zooms" in said.brief
    assert "zoom" in said.summary and "stabilise" not in said.summary


@pytest.mark.parametrize("larger", [1.15, 1.0])
def test_a_camera_that_turns_and_zooms_is_said_to_zoom_too(larger: float) -> None:
    shot = shot_of([View(FRONT, "front.mp4")], [BODY], [TRUTH], range(len(TRUTH)))
    still, count = wall(FRONT.size), len(TRUTH)
    pictures = {k: moved(still, 6.0 * k, -3.0 * k, larger=larger ** (k / (count - 1))) for k in range(count)}
    angles = np.arange(count)[:, None] / FRONT.matrix[0, 0] * [3.0, 6.0, 0.0]
    zooms = larger ** (np.arange(count) / (count - 1))
    turns = (zooming(zooms) @ Rotation.from_rotvec(angles).as_matrix(),)
    [said] = camera_fits(shot, SolvedShot((pictures,), ShotKeypoints(), 0.0, ((),), turns))[:1]
    assert isinstance(said, MovedCamera) and said.followed and "allowed for" in said.summary
    assert ("zooms" in said.summary) == ("zooms" in said.brief) == (larger > 1)
    assert larger == 1 or f"is 115% as large on frame {count - 1} as on frame 0" in said.summary
    assert said.figures["enlarged"] == larger and said.figures["frames"] == [0, count - 1]


def test_of_a_camera_that_only_zooms_the_frames_are_told_between_which_it_does() -> None:
    shot = shot_of([View(FRONT, "front.mp4")], [BODY], [TRUTH], range(len(TRUTH)))
    turns = zooming(np.linspace(1.2, 1.0, len(TRUTH)))
    [said] = followed_cameras(shot, [turns])
    assert said.figures == {"shift": 0.0, "frames": [len(TRUTH) - 1, 0], "enlarged": 1.2, "followed": True}


def test_a_plain_background_is_named_only_if_other_cameras_move() -> None:
    """Nobody can tell whether its camera moved; if the others stand on tripods, it does so, too."""
    side = look_at("side", (2.8, -0.5, 1.5))
    shot = shot_of([View(FRONT, "front.mp4"), View(side, "side.mp4")], [BODY], [TRUTH], range(len(TRUTH)))
    plain = np.full((FRONT.size[1], FRONT.size[0], 3), 120, np.uint8)
    pictures = [{k: plain for k in range(len(TRUTH))}, {k: wall(FRONT.size) for k in range(len(TRUTH))}]
    assert not any(isinstance(own, PlainBackground) for own in fit_by_key_poses(shot, pictures))
    turned = MovedCamera("other", BackgroundShift(9.0, (0, 3)), followed=True)
    found = fit_by_key_poses(shot, pictures, followed=[turned])
    said = [own for own in found if isinstance(own, PlainBackground)]
    assert [own.camera for own in said] == ["front"]
    assert "too plain" in said[0].brief and "--views" in said[0].summary
