"""The examples that the repository ships hold together: footage, calibration, truth and shot file agree."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

import cv2
import numpy as np
import pytest
from kfmocap.core.body import landmark_positions
from kfmocap.core.formats.calibrations.calibration_files import load_cameras
from kfmocap.core.formats.trc import read_trc
from kfmocap.core.numerics import rotations
from kfmocap.core.tracking.prepare import load_shot
from render.takes import BESIDE_THE_WALK, PLANS, key_frames, make_take

EXAMPLES = Path(__file__).parents[2] / "examples"
WALK, BEAM = EXAMPLES / "walk", EXAMPLES / "beam"
FRAMES, FPS = 60, 30.0


@pytest.fixture(scope="module")
def take():
    return make_take("walk")


def test_walk_loads_as_a_shot():
    shot = load_shot(WALK / "shot.toml")
    assert shot.name == "walk" and shot.fps == FPS
    assert shot.frames == (0, FRAMES - 1)
    assert [view.camera.name for view in shot.views] == ["cam01", "cam02", "cam03"]
    assert list(shot.performers[0].key_poses.frames) == key_frames(FRAMES)


@pytest.mark.parametrize("name", ["cam01", "cam02", "cam03"])
def test_walk_footage_decodes_to_every_frame_at_the_calibrated_size(name):
    video = cv2.VideoCapture(str(WALK / f"{name}.mp4"))
    width, height = load_cameras(WALK / "calibration.toml")[name].size
    count = 0
    while True:
        ok, image = video.read()
        if not ok:
            break
        assert image.shape == (height, width, 3)
        count += 1
    assert count == FRAMES
    assert video.get(cv2.CAP_PROP_FPS) == pytest.approx(FPS)


def test_walk_truth_lies_inside_every_picture():
    truth = read_trc(WALK / "landmarks.trc")
    assert truth.points_world.shape[0] == FRAMES and np.isfinite(truth.points_world).all()
    for camera in load_cameras(WALK / "calibration.toml").values():
        uv = camera.project(truth.points_world)
        assert (uv >= 8).all() and (uv <= np.array(camera.size) - 9).all(), camera.name


def test_walk_files_are_what_the_script_writes(take):
    truth = read_trc(WALK / "landmarks.trc")
    assert list(truth.names) == take.landmarks
    np.testing.assert_allclose(truth.points_world, take.truth(), atol=1e-5)
    stored = load_cameras(WALK / "calibration.toml")
    for camera in BESIDE_THE_WALK:
        np.testing.assert_allclose(stored[camera.name].project(take.truth()), camera.project(take.truth()), atol=1e-3)


def test_walk_footage_shows_the_person_where_the_truth_says(take):
    """Checks the camera convention: where the trunk is, pixels differ from the empty room's."""
    for camera in load_cameras(WALK / "calibration.toml").values():
        video = cv2.VideoCapture(str(WALK / f"{camera.name}.mp4"))
        images = np.array([video.read()[1] for _ in range(FRAMES)])
        room = np.median(images[::4], axis=0)
        moved = np.abs(images[FRAMES // 2] - room).max(axis=2) > 20
        trunk = landmark_positions(take.body, take.motion[[FRAMES // 2]], ["Hip", "Neck"])[0].mean(axis=0)
        u, v = camera.project(trunk).round().astype(int)
        assert moved[v - 6 : v + 7, u - 6 : u + 7].mean() > 0.6, camera.name


def test_walk_is_under_three_megabytes():
    assert sum(path.stat().st_size for path in WALK.iterdir()) < 3e6


def test_beam_calibration_landmarks_and_sums_belong_together():
    found = load_cameras(BEAM / "calibration.toml")
    lines = (BEAM / "SHA256SUMS").read_text().splitlines()
    assert all(re.fullmatch(r"[0-9a-f]{64}  cam\d\d\.mp4", line) for line in lines)
    assert sorted(line[66:71] for line in lines) == sorted(found)
    truth = read_trc(BEAM / "landmarks.trc")
    assert truth.points_world.shape == (100, 15, 3)
    for camera in found.values():
        uv = camera.project(truth.points_world)
        assert (uv >= 0).all() and (uv < camera.size).all(), camera.name


def test_beam_shot_file_names_its_own_files():
    shot = tomllib.loads((BEAM / "shot.toml").read_text())
    assert shot["shot"]["frames"] == [0, 99]
    assert [view["footage"] for view in shot["view"]] == [f"{view['camera']}.mp4" for view in shot["view"]]
    assert (BEAM / shot["calibration"]["file"]).is_file()
    assert (BEAM / shot["performer"][0]["landmarks"]).is_file()


@pytest.mark.parametrize("name", sorted(PLANS))
def test_motions_are_deterministic_and_keep_the_joint_limits(name):
    first, second = make_take(name), make_take(name)
    np.testing.assert_array_equal(first.motion.rotations, second.motion.rotations)
    np.testing.assert_array_equal(first.motion.translations, second.motion.translations)
    turns = rotations.log(first.motion.rotations)
    low, high = first.body.limits[:, :, 0], first.body.limits[:, :, 1]
    broken = (turns < low - 1e-9) | (turns > high + 1e-9)
    assert not broken.any(), {first.body.names[i] for _, i, _ in np.argwhere(broken)}


def test_walking_feet_stand_on_the_floor_and_do_not_skate(take):
    feet = landmark_positions(take.body, take.motion, ["RHeel", "RBigToe", "LHeel", "LBigToe"])
    lowest = feet[..., 2].min(axis=1)
    assert (lowest > 0.0).all() and (lowest < 0.05).all()
    speed = np.linalg.norm(np.diff(feet, axis=0), axis=2).min(axis=1) * FPS
    assert speed.max() < 0.6
