"""Cameras come from a performer's keypoints and height alone: where they are, their focal lengths, and the world."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from keypoint_shots import NAMES, SIZE, cameras, seen_places, strolling, write_openpose
from kfmocap.__main__ import main
from kfmocap.core.body import human
from kfmocap.core.body.motion import Motion
from kfmocap.core.calibration.performer.limb_residuals import JointScene, JointSightings, joint_equations, usual_lengths
from kfmocap.core.calibration.performer.performer_cameras import PerformerCalibration, cameras_by_performer
from kfmocap.core.calibration.performer.performer_views import PerformerView, joint_sightings
from kfmocap.core.calibration.solving.camera_rig import CAMERA_DOF, rig_of
from kfmocap.core.cameras.camera import Camera
from kfmocap.core.errors import CaptureError
from kfmocap.core.formats.calibrations.calibration_files import load_cameras, save_cameras
from kfmocap.core.shot.detections import Detections
from scipy.spatial.transform import Rotation

FRAMES = 45
HEIGHT = 1.8


def walking_about(frames: int = FRAMES) -> Motion:
    """A walk through the middle of the room, which turns on the way."""
    motion = strolling(human(HEIGHT), frames)
    turn = Rotation.from_rotvec(np.outer(np.linspace(-0.8, 0.8, frames), [0, 0, 1]))
    rotations = motion.rotations.copy()
    rotations[:, 0] = turn.as_matrix() @ rotations[:, 0]
    return Motion(motion.translations, rotations)


def detections(camera: Camera, places: np.ndarray, noise: float = 0.0) -> Detections:
    """What a detector would find of a person whose keypoints are at points (F, L, 3)."""
    rng = np.random.default_rng(int(camera.name[-2:]))
    pixels = np.stack([camera.project(points, f) for f, points in enumerate(places)])
    pixels += rng.normal(0, noise, pixels.shape)
    F = len(places)
    return Detections(NAMES, np.arange(F), pixels, np.full(pixels.shape[:2], 0.9), np.full(F, -1))


def views_of(given: list[Camera], noise: float = 0.0) -> list[PerformerView]:
    places = seen_places(human(HEIGHT), walking_about())
    return [PerformerView(c.name, c.size, detections(c, places, noise)) for c in given]


def errors(found: PerformerCalibration, given: list[Camera]) -> tuple[float, float, float]:
    """Farthest turn, degrees, and place, metres, after moving the world; and the tilt of the world, degrees."""
    R, R_true = (np.stack([c.R_cam_world[0] for c in some]) for some in (list(found.cameras.values()), given))
    places, true = (rig_of(some).centres_world for some in (list(found.cameras.values()), given))
    world = Rotation.from_matrix(np.swapaxes(R_true, 1, 2) @ R).mean()
    turns = Rotation.from_matrix(R @ world.inv().as_matrix() @ np.swapaxes(R_true, 1, 2)).magnitude()
    apart = world.apply(places - places.mean(axis=0)) - (true - true.mean(axis=0))
    tilt = np.degrees(np.arccos(world.as_matrix()[2, 2]))
    return float(np.degrees(turns).max()), float(np.linalg.norm(apart, axis=1).max()), float(tilt)


@pytest.fixture(scope="module")
def found() -> PerformerCalibration:
    """Three cameras by keypoints with a pixel of noise."""
    return cameras_by_performer(views_of(cameras(3), noise=1.0), HEIGHT, (0, FRAMES - 1))


def test_cameras_and_focal_lengths_come_from_keypoints_and_a_height(found: PerformerCalibration) -> None:
    given = cameras(3)
    turn, apart, tilt = errors(found, given)
    assert turn < 1.0 and apart < 0.15 and tilt < 3.0
    focal = np.array([camera.matrix[0, 0] for camera in found.cameras.values()])
    assert np.abs(focal / given[0].matrix[0, 0] - 1).max() < 0.04


def test_a_known_lens_is_kept_and_makes_the_cameras_exact() -> None:
    bent = [
        Camera.create(c.name, c.size, c.matrix, c.R_cam_world, c.t_cam_world, distortions=[-0.2, 0.03, 0, 0])
        for c in cameras(3)
    ]
    views = [replace(view, lens=camera) for view, camera in zip(views_of(bent), bent, strict=True)]
    found = cameras_by_performer(views, HEIGHT, (0, FRAMES - 1))
    turn, apart, _ = errors(found, bent)
    assert turn < 0.1 and apart < 0.02
    for camera, true in zip(found.cameras.values(), bent, strict=True):
        np.testing.assert_array_equal(camera.matrix, true.matrix)
        np.testing.assert_array_equal(camera.distortions, true.distortions)


def test_the_world_stands_on_the_floor_below_the_performer(found: PerformerCalibration) -> None:
    given = rig_of(cameras(3)).centres_world
    places = rig_of(list(found.cameras.values())).centres_world
    np.testing.assert_allclose(places[:, 2], given[:, 2], atol=0.15)
    hips = walking_about().translations[0, :2]
    apart = np.linalg.norm(places[:, :2], axis=1) - np.linalg.norm(given[:, :2] - hips, axis=1)
    assert np.abs(apart).max() < 0.2


def test_half_the_height_is_half_the_world(found: PerformerCalibration) -> None:
    half = cameras_by_performer(views_of(cameras(3), noise=1.0), HEIGHT / 2, (0, FRAMES - 1))
    places = [rig_of(list(one.cameras.values())).centres_world for one in (half, found)]
    np.testing.assert_allclose(2 * places[0], places[1], atol=0.02)


def test_keypoints_on_the_wrong_side_are_outvoted() -> None:
    given = cameras(3)
    views = [replace(view, lens=camera) for view, camera in zip(views_of(given, noise=1.0), given, strict=True)]
    swapped = [name.replace("L", "R", 1) if name[0] == "L" else name.replace("R", "L", 1) for name in NAMES]
    order = [NAMES.index(name) if name in NAMES else k for k, name in enumerate(swapped)]
    points = views[1].detections.points.copy()
    points[::5] = points[::5][:, order]
    views[1] = replace(views[1], detections=replace(views[1].detections, points=points))
    turn, apart, _ = errors(cameras_by_performer(views, HEIGHT, (0, FRAMES - 1)), given)
    assert turn < 0.6 and apart < 0.06


def test_of_several_people_the_largest_counts() -> None:
    [camera] = cameras(1)
    places = seen_places(human(HEIGHT), walking_about())
    near, far = detections(camera, places), detections(camera, places + [1.5, 6.0, 0.0])
    both = Detections(
        NAMES,
        np.repeat(near.frames, 2),
        np.stack([far.points, near.points], axis=1).reshape(-1, len(NAMES), 2),
        np.full((2 * FRAMES, len(NAMES)), 0.9),
        np.full(2 * FRAMES, -1),
    )
    alone, among = (
        joint_sightings([PerformerView("a", SIZE, seen), PerformerView("b", SIZE, near)], (0, FRAMES - 1))
        for seen in (near, both)
    )
    np.testing.assert_array_equal(among.points, alone.points)


def test_of_a_camera_with_twice_the_frame_rate_every_second_frame_is_used() -> None:
    view, twice = views_of(cameras(1))[0], 2 * np.arange(FRAMES)
    seen = view.detections
    between = replace(seen, frames=2 * seen.frames + 1, points=seen.points + 50.0)
    for offset in (0, 3):
        both = Detections(
            NAMES,
            offset + np.concatenate([twice, between.frames]),
            np.concatenate([seen.points, between.points]),
            np.concatenate([seen.confidence, between.confidence]),
            np.concatenate([seen.tracks, between.tracks]),
        )
        fast = replace(view, detections=both, offset=offset, every=2)
        found, usual = (joint_sightings([one], (0, FRAMES - 1)) for one in (fast, view))
        np.testing.assert_array_equal(found.points, usual.points)


def test_derivatives_are_those_of_the_cost() -> None:
    rng = np.random.default_rng(3)
    rig = rig_of(cameras(2))
    scene = JointScene(rig, rng.normal([0, 0, 1], 0.3, (3, 12, 3)), 0.9 * usual_lengths(HEIGHT))
    points = rng.normal([320, 240], 60, (2, 3, 12, 2))
    seen = JointSightings(rig.names, rig.sizes, np.arange(3), points, rng.uniform(0.4, 1, (2, 3, 12)))
    free = np.ones(3 * 36 + 6 + 2 * CAMERA_DOF, bool)
    unmoved = np.r_[7:13]  # principal point, distortion and clock have no derivatives here
    for c in range(2):
        free[3 * 36 + 6 + c * CAMERA_DOF + unmoved] = False

    def cost(step: np.ndarray) -> float:
        whole = np.zeros(len(free))
        whole[free] = step
        return joint_equations(scene.moved(whole), seen, HEIGHT, noise=np.array([40.0, 60.0]), free=free).cost

    gradient = joint_equations(scene, seen, HEIGHT, noise=np.array([40.0, 60.0]), free=free).gradient
    for k in rng.choice(int(free.sum()), 40, replace=False):
        step = np.zeros(int(free.sum()))
        step[k] = 1e-6
        numeric = (cost(step) - cost(-step)) / 4e-6
        assert numeric == pytest.approx(gradient[k], rel=1e-5, abs=1e-4 * np.abs(gradient).max())


def test_what_is_missing_is_said() -> None:
    views = views_of(cameras(2))
    with pytest.raises(CaptureError, match="two views or more"):
        cameras_by_performer(views[:1], HEIGHT, (0, FRAMES - 1))
    with pytest.raises(CaptureError, match=r"does not show where the cameras are.*cam01 4, cam02 4"):
        cameras_by_performer(views, HEIGHT, (0, 3))


def test_the_command_writes_the_calibration_that_the_shot_names(tmp_path: Path, capsys) -> None:
    given, places = cameras(2), seen_places(human(HEIGHT), walking_about())
    text = f'[shot]\nname = "s"\nfps = 30.0\nframes = [0, {FRAMES - 1}]\n[calibration]\nfile = "found.toml"\n'
    for camera in given:
        write_openpose(tmp_path / camera.name, camera, [places], noise=1.0)
        video = cv2.VideoWriter(str(tmp_path / f"{camera.name}.mp4"), cv2.VideoWriter.fourcc(*"mp4v"), 30, SIZE)
        for _ in range(2):
            video.write(np.zeros((SIZE[1], SIZE[0], 3), np.uint8))
        video.release()
        text += f'[[view]]\ncamera = "{camera.name}"\nfootage = "{camera.name}.mp4"\nkeypoints = "{camera.name}"\n'
    shot = tmp_path / "shot.toml"
    shot.write_text(text + '[[performer]]\nname = "p"\nkeyframes = "auto"\n')
    out = tmp_path / "found.toml"
    assert main(["calibrate", "--performer", str(shot), "--out", str(out)]) == 1
    assert "height: the performer's height is missing" in capsys.readouterr().err and not out.exists()
    shot.write_text(shot.read_text() + f"height = {HEIGHT}\n")
    lenses = tmp_path / "lenses.toml"
    save_cameras(lenses, given)
    assert main(["calibrate", "--performer", str(shot), "--lenses", str(lenses), "--out", str(out)]) == 0
    for camera in given:
        np.testing.assert_allclose(load_cameras(out)[camera.name].matrix, camera.matrix)
