"""Keypoints are those of the footage's frames, whether a detector counts pictures from 0, from 1 or by their names."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from kfmocap.core.formats.keypoint_files import read_keypoints

FRAMES = 5


def body(frame: int) -> list[float]:
    """COCO's 17 keypoints, whose first shows the frame."""
    return [100.0 + frame, 50.0, 0.9, *[60.0, 70.0, 0.9] * 16]


def frames_of(keypoints: Path, footage: Path | None) -> dict[int, int]:
    """By the number of the frame that a person is read on, the frame on which it was seen."""
    found = read_keypoints(keypoints, (64, 48), footage=footage)
    seen = found.points[:, found.names.index("Nose"), 0] - 100
    return dict(zip(found.frames.tolist(), seen.round().astype(int).tolist(), strict=True))


def write_folder(folder: Path, name: str, first: int, frames: int = FRAMES, nobody: tuple[int, ...] = ()) -> Path:
    folder.mkdir()
    for frame in range(frames):
        people: list[Any] = [] if frame in nobody else [{"pose_keypoints_2d": body(frame)}]
        (folder / (name % (first + frame))).write_text(json.dumps({"people": people}))
    return folder


def write_images(folder: Path, name: str, first: int, step: int = 1) -> Path:
    folder.mkdir()
    for frame in range(FRAMES):
        cv2.imwrite(str(folder / (name % (first + step * frame))), np.zeros((48, 64, 3), np.uint8))
    return folder


@pytest.mark.parametrize("first", [0, 1, 1001])
@pytest.mark.parametrize("name", ["%04d_keypoints.json", "%04d.json"])
def test_files_named_like_the_images_are_of_these_images(tmp_path: Path, first: int, name: str) -> None:
    images = write_images(tmp_path / "images", "%04d.png", first)
    keypoints = write_folder(tmp_path / "pose", name, first, nobody=(0,))
    assert frames_of(keypoints, images / "%04d.png") == {f: f for f in range(1, FRAMES)}


def test_documents_that_name_the_images_are_of_these_images(tmp_path: Path) -> None:
    images = write_images(tmp_path / "images", "shot_%d.png", 10, step=2)
    document = [{"image_id": f"images/shot_{10 + 2 * f}.png", "keypoints": body(f)} for f in range(FRAMES)]
    (tmp_path / "pose.json").write_text(json.dumps(document))
    assert frames_of(tmp_path / "pose.json", images / "shot_*.png") == {f: f for f in range(FRAMES)}


@pytest.fixture
def video(tmp_path: Path) -> Path:
    path = tmp_path / "film.mp4"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*"mp4v"), 30.0, (64, 48))
    for _ in range(FRAMES):
        writer.write(np.zeros((48, 64, 3), np.uint8))
    writer.release()
    return path


@pytest.mark.parametrize("first", [0, 1])
@pytest.mark.parametrize("nobody", [(), (0, FRAMES - 1)])
def test_pictures_of_a_video_may_be_counted_from_0_or_1(
    tmp_path: Path, video: Path, first: int, nobody: tuple[int, ...]
) -> None:
    keypoints = write_folder(tmp_path / "pose", "film_%06d.json", first, nobody=nobody)
    assert frames_of(keypoints, video) == {f: f for f in range(FRAMES) if f not in nobody}


def test_ids_of_pictures_may_be_counted_from_1(tmp_path: Path, video: Path) -> None:
    (tmp_path / "pose.json").write_text(json.dumps([{"image_id": 1 + f, "keypoints": body(f)} for f in range(FRAMES)]))
    assert frames_of(tmp_path / "pose.json", video) == {f: f for f in range(FRAMES)}


def test_what_does_not_end_beyond_the_footage_is_counted_from_0(tmp_path: Path, video: Path) -> None:
    keypoints = write_folder(tmp_path / "pose", "film_%06d.json", 1, FRAMES - 1)
    assert frames_of(keypoints, video) == {1 + f: f for f in range(FRAMES - 1)}


def test_without_footage_the_numbers_count(tmp_path: Path) -> None:
    keypoints = write_folder(tmp_path / "pose", "%04d.json", 1)
    expected = {1 + f: f for f in range(FRAMES)}
    assert frames_of(keypoints, None) == frames_of(keypoints, tmp_path / "gone.mp4") == expected
