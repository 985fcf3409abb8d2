"""Hands in the files of detectors become points in space: those of the performer, wherever others stand."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from keypoint_shots import cameras, person, person_with_hands, strolling, triples
from kfmocap.core.body import landmark_positions
from kfmocap.core.errors import KeypointError
from kfmocap.core.formats.keypoint_files import read_keypoints, read_shot_keypoints
from kfmocap.core.formats.keypoint_layouts import HAND_NAMES
from kfmocap.core.keypoints.hand_points import hand_points
from kfmocap.core.shot.shot import KeyPoses, Performer, Shot, View

BODY, FRAMES = person(), 8
WALK = strolling(BODY, FRAMES)
WRISTS = landmark_positions(BODY, WALK, ["LWrist", "RWrist"])
HANDS = WRISTS[:, :, None] + np.random.default_rng(0).normal(0, 0.04, (21, 3)) * (np.arange(21) > 0)[:, None]
"""The true points, (F, 2, 21, 3): the first is the wrist."""
OTHER = np.array([0.8, 0.3, 0.1])
"""From a hand to one of somebody else."""


def whole_body(pixels: np.ndarray, frame: int) -> dict:
    values = np.concatenate([np.full((91, 2), 50.0), pixels])
    return {"image_id": frame, "category_id": 1, "keypoints": triples(values), "score": 1.0}


def holistic(pixels: np.ndarray, frame: int, size: tuple[int, int]) -> dict:
    shares = (pixels + 0.5) / size
    marks = [{"x": float(x), "y": float(y), "z": 0.0} for x, y in shares]
    pose = [{"x": 0.5, "y": 0.5, "z": 0.0, "visibility": 0.9}] * 33
    return {
        "frame": frame,
        "pose_landmarks": pose,
        "left_hand_landmarks": marks[:21],
        "right_hand_landmarks": marks[21:],
    }


def write(folder: Path, view, kind: str, places: list[np.ndarray], noise: float = 0.0) -> Path:
    """Keypoints of hands at places (F, 42, 3) of several people, as a detector writes them."""
    rng = np.random.default_rng(int(view.name[-2:]))
    pixels = [[view.project(p[f]) + rng.normal(0, noise, (42, 2)) for p in places] for f in range(FRAMES)]
    path = folder / f"{view.name}.json"
    if kind == "openpose":
        path = folder / view.name
        path.mkdir()
        for f, people in enumerate(pixels):
            (path / f"{view.name}_{f:06d}.json").write_text(
                json.dumps({"people": [person_with_hands(p) for p in people]})
            )
    elif kind == "whole body":
        path.write_text(json.dumps([whole_body(p, f) for f, people in enumerate(pixels) for p in people]))
    else:
        path.write_text(json.dumps([holistic(people[0], f, view.size) for f, people in enumerate(pixels)]))
    return path


def shot_with(folder: Path, kind: str, places: list[np.ndarray], noise: float = 0.0, count: int = 3) -> Shot:
    views = tuple(
        View(view, folder / "none.mp4", keypoints=write(folder, view, kind, places, noise) if i < count else None)
        for i, view in enumerate(cameras(3))
    )
    performer = Performer("man", BODY, KeyPoses.whole([0], WALK[[0]]))
    return Shot("hands", 30.0, (0, FRAMES - 1), views, (performer,))


@pytest.mark.parametrize("kind", ["openpose", "whole body", "holistic"])
def test_hands_of_every_detector_are_where_they_are_seen(tmp_path: Path, kind: str) -> None:
    places = [HANDS.reshape(FRAMES, 42, 3)]
    if kind != "holistic":  # it finds one person
        places.insert(0, places[0] + OTHER)
    shot = shot_with(tmp_path, kind, places)
    found = hand_points(shot, read_shot_keypoints(shot, hands=True), WRISTS)
    np.testing.assert_allclose(found, HANDS, atol=1e-4)


def test_a_pixel_of_noise_is_some_millimetres(tmp_path: Path) -> None:
    shot = shot_with(tmp_path, "whole body", [HANDS.reshape(FRAMES, 42, 3)], noise=0.5)
    found = hand_points(shot, read_shot_keypoints(shot, hands=True), WRISTS)
    assert np.nanmedian(np.linalg.norm(found - HANDS, axis=-1)) < 0.008


def test_a_hand_that_is_not_the_performers_is_nobodys(tmp_path: Path) -> None:
    shot = shot_with(tmp_path, "openpose", [HANDS.reshape(FRAMES, 42, 3) + OTHER])
    with pytest.raises(KeypointError, match="0 of 3 views"):
        hand_points(shot, read_shot_keypoints(shot, hands=True), WRISTS)


def test_hands_in_a_single_view_are_refused(tmp_path: Path) -> None:
    shot = shot_with(tmp_path, "openpose", [HANDS.reshape(FRAMES, 42, 3)], count=1)
    with pytest.raises(KeypointError, match="1 of 3 views"):
        hand_points(shot, read_shot_keypoints(shot, hands=True), WRISTS)


def test_people_without_hands_are_left_out_and_the_body_is_read_as_before(tmp_path: Path) -> None:
    path = write(tmp_path, cameras(1)[0], "openpose", [HANDS.reshape(FRAMES, 42, 3)])
    plain = {"people": [{"pose_keypoints_2d": triples(np.full((25, 2), 50.0))}]}
    (path / "cam01_000000.json").write_text(json.dumps(plain))
    hands, body = read_keypoints(path, hands=True), read_keypoints(path)
    assert hands.names == HAND_NAMES and hands.frames.tolist() == list(range(1, FRAMES))
    assert len(body) == FRAMES and "LHandIndex1" not in body.names
