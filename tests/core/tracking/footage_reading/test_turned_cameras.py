"""A camera that is held in the hand, though its calibration has one pose, is tracked as if it had stood still."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from kfmocap.core.body.kinematics import part_poses, tip_positions
from kfmocap.core.cameras.camera import Camera
from kfmocap.core.cameras.lens_turns import split, zooming
from kfmocap.core.fitting.checks.background_checks import followed_cameras
from kfmocap.core.keypoints.keypoint_rays import Keypoints
from kfmocap.core.shot.settings import Settings
from kfmocap.core.shot.shot import Shot, View
from kfmocap.core.tracking.footage_reading.turned_cameras import turns_since, with_measured_turns, with_turns
from kfmocap.core.tracking.results.track_result import TrackResult
from kfmocap.core.tracking.retracking import Excerpt, track_excerpts
from kfmocap.core.tracking.tracker import track
from late_footage import BODY, CAMERAS, FRAMES, TRUTH, pictures
from scipy.spatial.transform import Rotation
from synthetic import rigidly_moved, shot_of

KEYS = (0, 9, 18)
SETTINGS = Settings(limb_search=False)
WAYS = np.sin(FRAMES[:, None] * [0.9, 0.5, 0.3]) * [0.8, 1.3, 0.7]
TURNS = Rotation.from_rotvec(np.radians(WAYS)).as_matrix()
"""From the camera's axes on the first frame, which has a key pose, to those on each."""
FILMED = {"still": None, "held": TURNS, "zooming": zooming(1 + 0.012 * FRAMES) @ TURNS}


def filmed(home: Path, camera: Camera, turns: np.ndarray | None) -> View:
    """What a camera shows before a wall, turned as its operator did."""
    home.mkdir(parents=True)
    rough = np.random.default_rng(3).uniform(40, 215, camera.size[::-1])
    wall = cv2.normalize(cv2.GaussianBlur(rough, (0, 0), 1.5), None, 30, 225, cv2.NORM_MINMAX)
    for f in FRAMES.tolist():
        shown = pictures(camera.name)[f]
        shown = np.where(shown == np.median(shown), wall, shown)
        if turns is not None:
            there = camera.matrix @ turns[f] @ np.linalg.inv(camera.matrix)
            shown = cv2.warpPerspective(shown, there, camera.size, flags=cv2.INTER_CUBIC, borderMode=cv2.BORDER_REFLECT)
        cv2.imwrite(str(home / f"{f:03d}.png"), np.clip(shown, 0, 255))
    return View(camera, home / "%03d.png")


@pytest.fixture(scope="module")
def shots(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Shot]:
    home, found = tmp_path_factory.mktemp("held"), {}
    side = filmed(home / "side", CAMERAS["side"], None)
    for name, turns in FILMED.items():
        views = [filmed(home / name, CAMERAS["front"], turns), side]
        found[name] = shot_of(views, [BODY], [TRUTH[FRAMES]], KEYS, SETTINGS)
    return found


@pytest.fixture(scope="module")
def tracked(shots: dict[str, Shot]) -> dict[str, TrackResult]:
    return {name: track(shot) for name, shot in shots.items()}


def unmeasured(shot: Shot) -> Shot:
    return replace(shot, settings=replace(SETTINGS, stabilise=False))


def error(result: TrackResult) -> float:
    """Mean distance of the tips of all parts from their true places, mm."""
    found, true = (tip_positions(BODY, part_poses(BODY, motion)) for motion in (result.motions[0], TRUTH[FRAMES]))
    return 1000 * float(np.linalg.norm(found - true, axis=-1).mean())


def test_it_is_tracked_nearly_as_well_as_if_it_had_stood_still(
    shots: dict[str, Shot], tracked: dict[str, TrackResult]
) -> None:
    still = error(tracked["still"])
    for name, worse in (("held", 1.3), ("zooming", 1.6)):
        assert error(track(unmeasured(shots[name]))) > 2 * still
        assert error(tracked[name]) < worse * still


def test_how_it_turned_is_found_to_within_a_third_of_a_pixel_and_told(
    shots: dict[str, Shot], tracked: dict[str, TrackResult]
) -> None:
    front, side = tracked["held"].turns
    assert side is None and front is not None
    assert CAMERAS["front"].displacements(front @ np.swapaxes(TURNS, 1, 2)).max() < 0.3
    [said] = followed_cameras(shots["held"], tracked["held"].turns)
    assert said.camera == "front" and said.off and said.background.frames[0] == 0
    assert "front: its camera moved" in said.summary and "than on frame 0" in said.summary


def test_how_its_lens_zooms_is_found_to_within_a_percent_and_told(
    shots: dict[str, Shot], tracked: dict[str, TrackResult]
) -> None:
    front = tracked["zooming"].turns[0]
    assert front is not None
    R, zooms = split(front)
    assert np.abs(zooms / (1 + 0.012 * FRAMES) - 1).max() < 0.01
    assert CAMERAS["front"].displacements(R @ np.swapaxes(TURNS, 1, 2)).max() < 0.6
    [said] = followed_cameras(shots["zooming"], tracked["zooming"].turns)
    assert f"as large on frame {len(FRAMES) - 1} as on frame 0" in said.summary and "allowed for" in said.summary


def test_cameras_that_stand_still_are_tracked_as_ever(shots: dict[str, Shot], tracked: dict[str, TrackResult]) -> None:
    still = track(unmeasured(shots["still"]))
    assert tracked["still"].turns == still.turns == (None, None)
    assert np.array_equal(tracked["still"].motions[0].rotations, still.motions[0].rotations)


def test_a_camera_whose_turns_are_known_is_tracked_like_one_that_was_found_to_turn(
    shots: dict[str, Shot], tracked: dict[str, TrackResult]
) -> None:
    result = tracked["held"]
    known = unmeasured(with_turns(shots["held"], result.turns))
    front, side = known.views
    longer = front.camera.at(range(len(FRAMES) + 3))  # with poses of later frames, too
    again = track(replace(known, views=(replace(front, camera=longer), side)))
    assert again.turns == (None, None)
    assert np.array_equal(result.motions[0].rotations, again.motions[0].rotations)


def test_of_key_poses_set_by_eye_over_the_shaking_pictures_all_are_as_they_were_seen(shots: dict[str, Shot]) -> None:
    camera, keys = CAMERAS["front"], list(KEYS)
    seen = TRUTH[FRAMES]
    for f in keys:
        G = camera.R_cam_world[0].T @ TURNS[f] @ camera.R_cam_world[0]
        moved = rigidly_moved(BODY, TRUTH[[f]], G, camera.centre_world() - G @ camera.centre_world())
        seen.translations[f], seen.rotations[f] = moved.translations[0], moved.rotations[0]
    by_eye = shot_of(shots["held"].views[:1], [BODY], [seen], KEYS, SETTINGS)
    found, true = ((turns_since(with_measured_turns(one, [0]), one))[0] for one in (by_eye, shots["held"]))
    assert found is not None and true is not None
    assert camera.displacements(true[keys]).max() > 2 and camera.displacements(found[keys]).max() < 1e-6
    assert camera.displacements(found).max() > 2


def test_how_it_turns_is_not_measured_on_a_part_of_a_shot(shots: dict[str, Shot]) -> None:
    """On another part the calibration would be taken to be of another frame."""
    [result] = track_excerpts(shots["held"], [Excerpt(0, 9)])
    assert result.turns == (None, None)


def test_keypoints_of_a_camera_that_turns_are_seen_where_one_that_stands_still_sees_them() -> None:
    points, camera = np.random.default_rng(1).normal([0, 0, 1], 0.4, (len(FRAMES), 5, 3)), CAMERAS["front"]
    R, t = camera.turned(TURNS).poses(0, len(FRAMES))

    def rays(R: np.ndarray, t: np.ndarray) -> np.ndarray:
        x = np.einsum("fab,flb->fla", R, points) + t[:, None]
        return x[..., :2] / x[..., 2:]

    seen = Keypoints(tuple("abcde"), rays(R, t)[None], np.ones((1, *points.shape[:2])), R[None], t[None])
    still = rays(np.stack([camera.R_cam_world[0]] * len(R)), np.stack([camera.t_cam_world[0]] * len(R)))
    assert np.allclose(seen.rays_to(0, camera.R_cam_world[0]), still)
