"""What is filmed decides, and not how it is put: frame rates, sizes, times, places, orders and cuts do not matter.

Of whole shots, the order of the cameras, the place of the world, the sense of time and a cut at a key pose are in
`test_tracking.py`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from keypoint_shots import NAMES, cameras, joint_errors, keypoints_of, person, seen_places, strolling
from kfmocap.core.body import landmark_positions
from kfmocap.core.body.motion import Motion
from kfmocap.core.cameras.camera import Camera
from kfmocap.core.keypoints.keypoint_motion.first_pass import scaled_first_pass
from kfmocap.core.keypoints.keypoint_motion.keypoint_fit import KeypointFit
from kfmocap.core.keypoints.keypoint_rays import Keypoints
from kfmocap.core.keypoints.observations import image_rays
from kfmocap.core.numerics import rotations
from kfmocap.core.numerics.repeatable import GRID
from kfmocap.core.shot.acceleration_prior import acceleration_precision
from kfmocap.core.shot.keypose_spline import spline
from kfmocap.core.shot.settings import Settings
from kfmocap.core.shot.shot import Shot, View
from kfmocap.core.tracking.tracker import track
from synthetic import figure, film, look_at, rigidly_moved, rigidly_moved_camera, shot_of, swing

FIGURE, LENGTH, SIZE = figure(), 11, (200, 150)
TRUTH = swing(FIGURE, LENGTH)
KEYS = (0, 5, 10)
ESTIMATED = Settings(estimate_smoothness=True)


def apart_mm(a: Motion, b: Motion) -> float:
    """Mean distance of the landmarks."""
    names = list(FIGURE.landmarks)
    places = [landmark_positions(FIGURE, motion, names) for motion in (a, b)]
    return float(1000 * np.linalg.norm(places[0] - places[1], axis=-1).mean())


@pytest.fixture(scope="module")
def views(tmp_path_factory: pytest.TempPathFactory) -> list[View]:
    eyes = {"front": (0.5, -2.8, 1.5), "side": (-2.4, -1.4, 1.3)}
    filming = [look_at(name, eye, size=SIZE, focal=237) for name, eye in eyes.items()]
    return film(tmp_path_factory.mktemp("filmed"), [FIGURE], [TRUTH], filming)


def filmed_shot(views: Sequence[View], fps: float = 30.0) -> Shot:
    return shot_of(views, [FIGURE], [TRUTH], KEYS, ESTIMATED, fps)


@pytest.fixture(scope="module")
def tracked(views: list[View]) -> Motion:
    return track(filmed_shot(views)).motions[0]


@pytest.mark.parametrize("fps", [15.0, 240.0])
def test_the_same_pictures_called_another_frame_rate_show_the_same_motion(
    views: list[View], tracked: Motion, fps: float
) -> None:
    found = track(filmed_shot(views, fps)).motions[0]
    assert apart_mm(found, tracked) < 0.02 * apart_mm(spline(filmed_shot(views).performers[0].key_poses, LENGTH), TRUTH)


@pytest.mark.parametrize(("count", "keys"), [(2, (0, 10)), (1, KEYS)])
def test_frame_rates_matter_little_with_two_key_poses_or_one_view(
    views: list[View], count: int, keys: Sequence[int]
) -> None:
    first, second = (
        shot_of(views[:count], [FIGURE], [TRUTH], keys, Settings(plants=False), fps) for fps in (15.0, 240.0)
    )
    between = apart_mm(track(first).motions[0], track(second).motions[0])
    assert between < 0.15 * apart_mm(spline(first.performers[0].key_poses, LENGTH), TRUTH)


def test_pictures_of_half_the_size_show_the_same_motion_nearly(
    views: list[View], tracked: Motion, tmp_path: Path
) -> None:
    halves = [_halved(view, tmp_path / view.camera.name) for view in views]
    found = track(filmed_shot(halves)).motions[0]
    assert apart_mm(found, tracked) < 1.5


def _halved(view: View, folder: Path) -> View:
    folder.mkdir()
    for f in range(LENGTH):
        image = cv2.imread(str(view.footage.parent / f"{f:03d}.png"))
        half = cv2.resize(image, (SIZE[0] // 2, SIZE[1] // 2), interpolation=cv2.INTER_AREA)
        assert cv2.imwrite(str(folder / f"{f:03d}.png"), half)
    return replace(view, camera=halved_camera(view.camera), footage=folder / "%03d.png")


def halved_camera(camera: Camera) -> Camera:
    """The camera whose pixels are two by two of another's."""
    matrix = camera.matrix.copy()
    matrix[:2] /= 2
    matrix[:2, 2] -= 0.25  # pixels' centres are at whole numbers
    return replace(camera, matrix=matrix, size=(camera.size[0] // 2, camera.size[1] // 2))


BODY, FRAMES, FPS = person(), 10, 30.0
STROLL = strolling(BODY, FRAMES)
VIEWS = cameras(3)


def seen(order: Sequence[int] = (0, 1, 2)) -> Keypoints:
    """Noisy keypoints of somebody who strolls, the views in some order."""
    found = keypoints_of(VIEWS, seen_places(BODY, STROLL), noise=0.012)
    index = list(order)
    return Keypoints(
        NAMES, found.rays[index], found.confidence[index], found.R_cam_world[index], found.t_cam_world[index]
    )


def fit(keypoints: Keypoints, fps: float = FPS) -> KeypointFit:
    precision = acceleration_precision(BODY, fps, Settings())
    return scaled_first_pass(keypoints, fps=fps, precision=precision, correlated=3.0)


@pytest.fixture(scope="module")
def first_pass() -> KeypointFit:
    return fit(seen())


def fits_apart_mm(a: KeypointFit, b: KeypointFit) -> float:
    """Mean distance of the joints."""
    return float(1000 * joint_errors(a.body, a.motion, b.body, b.motion).mean())


def test_keypoints_show_the_same_whatever_the_order_of_the_cameras(first_pass: KeypointFit) -> None:
    assert fits_apart_mm(fit(seen((2, 0, 1))), first_pass) < 0.5


def test_keypoints_show_the_same_wherever_the_world_is(first_pass: KeypointFit) -> None:
    G, s = rotations.exp(np.array([0.0, 0.0, 2.1])), np.array([3.0, -1.0, 0.4])
    moved = [rigidly_moved_camera(camera, G, s) for camera in VIEWS]
    there = replace(
        seen(),
        R_cam_world=np.stack([camera.poses(0, FRAMES)[0] for camera in moved]),
        t_cam_world=np.stack([camera.poses(0, FRAMES)[1] for camera in moved]),
    )
    found = fit(there)
    back = rigidly_moved(first_pass.body, first_pass.motion, G, s)
    assert 1000 * joint_errors(found.body, found.motion, first_pass.body, back).mean() < 0.5


def test_keypoints_show_the_same_backwards(first_pass: KeypointFit) -> None:
    ahead = seen()
    turned = {name: getattr(ahead, name)[:, ::-1] for name in ("rays", "confidence", "R_cam_world", "t_cam_world")}
    found = fit(replace(ahead, **turned))
    assert 1000 * joint_errors(found.body, found.motion[::-1], first_pass.body, first_pass.motion).mean() < 1.5


def test_what_keypoints_show_does_not_depend_on_roundings(first_pass: KeypointFit) -> None:
    """What they say little about, as the twist of a stretched arm, does not go far in every iteration."""
    ahead = seen()
    other = replace(ahead, rays=ahead.rays + np.random.default_rng(0).normal(0, 1e-9, ahead.rays.shape))
    apart = np.abs(first_pass.motion.difference(fit(other).motion))
    assert apart.max() < 1.1 * GRID  # rounded the other way
    assert (apart < 0.1 * GRID).mean() > 0.98


def test_keypoints_in_half_as_large_pictures_are_on_the_same_rays() -> None:
    camera = replace(VIEWS[0], distortions=np.array([-0.2, 0.05, 0.001, 0.0]))
    small = halved_camera(camera)
    pixels = np.random.default_rng(0).uniform(100, 400, (20, 2))
    np.testing.assert_allclose(image_rays(small, pixels / 2 - 0.25), image_rays(camera, pixels), atol=1e-9)
