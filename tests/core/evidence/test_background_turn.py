"""How a camera turned and zoomed is found in its pictures, turns to 0.3 pixels, whatever else moves in them."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from kfmocap.core.cameras.camera import Camera
from kfmocap.core.cameras.lens_turns import since, split, zooming
from kfmocap.core.evidence import background_turn
from kfmocap.core.evidence.background_turn import background_turns
from scipy.spatial.transform import Rotation
from synthetic import look_at
from test_background_shift import wall

CAMERA = look_at("front", (0.5, -2.8, 1.5), size=(320, 240), focal=380)
DEGREES = [[0, 0, 0], [0.2, -0.5, 0.3], [-0.6, 1.4, -1.0], [1.0, 1.1, 0.8]]
TURNS = Rotation.from_rotvec(np.radians(DEGREES)).as_matrix()


def turned(picture: np.ndarray, turn: np.ndarray) -> np.ndarray:
    """The picture of the camera once its axes have turned."""
    K = CAMERA.matrix
    there = K @ turn @ np.linalg.inv(K)
    return cv2.warpPerspective(picture, there, CAMERA.size, flags=cv2.INTER_CUBIC, borderMode=cv2.BORDER_REFLECT)


def filmed(turns: np.ndarray, noise: float = 3.0) -> list[np.ndarray]:
    still, rng = cv2.cvtColor(wall(CAMERA.size), cv2.COLOR_BGR2GRAY), np.random.default_rng(5)
    shown = (turned(still, turn) + rng.normal(0, noise, still.shape) for turn in turns)
    return [np.clip(picture, 0, 255).astype(np.uint8) for picture in shown]


def nobody(_number: int) -> np.ndarray:
    return np.zeros(CAMERA.size[::-1], bool)


def walker(number: int) -> np.ndarray:
    """Where somebody is who fills half of every picture."""
    there, width = nobody(number), CAMERA.size[0]
    there[:, number * width // 16 : (number + 8) * width // 16] = True
    return there


def passed_by(pictures: list[np.ndarray]) -> list[np.ndarray]:
    """Somebody in checked clothes walks through the pictures."""
    width, height = CAMERA.size
    clothes = cv2.resize(np.random.default_rng(8).uniform(0, 255, (height // 8, width // 16)), (width // 2, height))
    for number, picture in enumerate(pictures):
        picture[walker(number)] = clothes.astype(np.uint8).ravel()
    return pictures


def off(found: np.ndarray, true: np.ndarray) -> np.ndarray:
    """By how many pixels turns differ in the picture."""
    return CAMERA.displacements(found @ np.linalg.inv(true))


def test_the_turn_is_found_to_within_a_third_of_a_pixel() -> None:
    found = background_turns(iter(filmed(TURNS)), CAMERA, nobody)
    assert CAMERA.displacements(TURNS).max() > 5
    assert found is not None and off(found, TURNS).max() < 0.3


def test_somebody_who_fills_half_the_picture_does_not_pull_it() -> None:
    found = background_turns(iter(passed_by(filmed(TURNS))), CAMERA, walker)
    assert found is not None and off(found, TURNS).max() < 0.3


def test_a_camera_that_stands_still_does_not_turn() -> None:
    still = np.stack([np.eye(3)] * len(TURNS))
    found = background_turns(iter(passed_by(filmed(still))), CAMERA, walker)
    assert found is not None and off(found, still).max() < 0.1


def test_a_plain_wall_tells_nothing_and_a_covered_lens_nothing_on_its_frames() -> None:
    plain = np.full(CAMERA.size[::-1], 120, np.uint8)
    assert background_turns(iter([plain, plain]), CAMERA, nobody) is None
    pictures = filmed(TURNS)
    pictures[2] = plain
    found = background_turns(iter(pictures), CAMERA, nobody)
    assert found is not None and np.flatnonzero(np.isnan(found[:, 0, 0])).tolist() == [2]
    assert off(found, TURNS)[[1, 3]].max() < 0.3


@pytest.mark.parametrize("distortions", [(0.0,) * 4, (-0.15, 0.05, 0.001, -0.001)])
def test_pictures_that_are_turned_back_show_each_ray_where_it_was_before(distortions: tuple[float, ...]) -> None:
    """The maps lead from a pixel before to where the lens shows the same ray after the turn."""
    width, height = CAMERA.size
    u, v = np.meshgrid(np.arange(20, width - 20, 30), np.arange(20, height - 20, 30))
    before = np.stack([u, v, np.ones_like(u)], axis=-1) @ np.linalg.inv(CAMERA.matrix).T
    lens = Camera.create("lens", CAMERA.size, CAMERA.matrix, np.eye(3), np.zeros(3), distortions=distortions)
    maps = lens.rectify_maps(TURNS[3].T)
    assert maps is not None
    led = maps[0][v, u] + np.stack([maps[1][v, u] % 32, maps[1][v, u] // 32], axis=-1) / 32
    assert np.abs(led - lens.project(before @ TURNS[3].T)).max() < 0.1


def zoomed(pictures: list[np.ndarray], zooms: np.ndarray) -> list[np.ndarray]:
    """Corners lie on one side of the picture's centre, so that they move aside as it zooms."""
    (width, height), found = CAMERA.size, []
    for picture, zoom in zip(pictures, zooms, strict=True):
        enlarged = cv2.getRotationMatrix2D(CAMERA.matrix[:2, 2].tolist(), 0, zoom)
        found.append(cv2.warpAffine(picture, enlarged, (width, height), flags=cv2.INTER_CUBIC))
        found[-1][:, : width // 3] = 120
    return found


@pytest.mark.parametrize("turns", [np.stack([np.eye(3)] * 8), np.repeat(TURNS, 2, axis=0)])
@pytest.mark.parametrize("calibrated", [0, 5])
def test_of_a_lens_that_zooms_the_focal_lengths_are_found_and_no_turns_in_their_place(
    turns: np.ndarray, calibrated: int
) -> None:
    """The calibration has the focal length of one of the pictures."""
    zooms = 1 + 0.02 * np.arange(8)
    pictures = zoomed(filmed(turns), zooms / zooms[calibrated])
    found = background_turns(iter(pictures), CAMERA, nobody, calibrated)
    assert found is not None
    R, known = split(found)
    true = zooming(zooms) @ turns
    assert off(R, turns).max() < 1
    assert np.abs(known / zooms - 1).max() < 0.004
    assert off(since(found, found[[calibrated]]), since(true, true[[calibrated]])).max() < 1


def test_a_lens_that_hardly_zooms_does_not() -> None:
    found = background_turns(iter(zoomed(filmed(TURNS), np.array([1.0, 1.004, 1.008, 1.012]))), CAMERA, nobody)
    assert found is not None and (split(found)[1] == 1).all()


def test_a_picture_in_which_no_zoom_is_found_takes_no_others_with_it(monkeypatch: pytest.MonkeyPatch) -> None:
    """Somebody passes by, so that corners of the third picture take the place of earlier ones."""
    zooms, view = 1 + 0.02 * np.arange(8), background_turn._FollowedCorners.view

    def found() -> np.ndarray:
        pictures = zoomed(passed_by(filmed(np.repeat(TURNS, 2, axis=0))), zooms)
        turns = background_turns(iter(pictures), CAMERA, walker)
        assert turns is not None
        return split(turns)[1][:5]

    def failing(self: background_turn._FollowedCorners, *given: object, zooms: bool = False) -> object:
        return None if zooms and self.origin == 1 else view(self, *given, zooms=zooms)  # type: ignore[arg-type]

    whole = found()
    monkeypatch.setattr(background_turn._FollowedCorners, "view", failing)
    assert np.flatnonzero(np.isnan(found())).tolist() == [2]
    np.testing.assert_allclose(np.delete(found(), 2), np.delete(whole, 2), rtol=0.02)
