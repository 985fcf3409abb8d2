"""Damage that the decoder complains of is caught, and put down to its view and frame."""

from __future__ import annotations

import os
import sys
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from kfmocap.core.runtime.decoder_log import DecoderLog
from kfmocap.core.shot.footage_faults.footage_damage import footage_damage, shot_damage
from kfmocap.core.shot.footage_faults.footage_times import whole_pictures
from kfmocap.core.shot.shot import Shot, View
from synthetic import figure, look_at, shot_of, swing

FRAMES, FPS, DAMAGED = 24, 30.0, 12
BODY = figure()
TRUTH = swing(BODY, FRAMES)
CAMERAS = [look_at("front", (0.5, -2.8, 1.5)), look_at("side", (2.8, -0.5, 1.5))]


@pytest.fixture(scope="module")
def film(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("film") / "whole.mp4"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*"mp4v"), FPS, CAMERAS[0].size)
    pictures = np.random.default_rng(1)
    for _ in range(FRAMES):
        writer.write(pictures.integers(0, 255, (*CAMERAS[0].size[::-1], 3)).astype(np.uint8))
    writer.release()
    return path


@pytest.fixture(scope="module")
def damaged(film: Path) -> Path:
    """The same with a run of zeros in a frame."""
    data, video = bytearray(film.read_bytes()), cv2.VideoCapture(str(film), cv2.CAP_FFMPEG, [cv2.CAP_PROP_FORMAT, -1])
    packets = [video.read()[1].tobytes() for _ in range(FRAMES)]
    video.release()
    middle = data.index(packets[DAMAGED]) + len(packets[DAMAGED]) // 2
    data[middle : middle + 64] = bytes(64)
    path = film.with_name("damaged.mp4")
    path.write_bytes(data)
    return path


def shot(*paths: Path) -> Shot:
    views = [View(camera, path) for camera, path in zip(CAMERAS, paths, strict=False)]
    return shot_of(views, [BODY], [TRUTH], (0, FRAMES - 1), fps=FPS)


@pytest.mark.parametrize(
    ("torn", "frames"),
    [
        ((12,), (0, 11)),
        ((4, 5, 12), (4, 11)),
        ((4, 5, 9, 12), (9, 11)),
        ((11, 12), None),
        ((7,), None),
        ((), None),
        ((14,), None),
    ],
)
def test_pictures_that_jump_to_one_that_is_stored_whole_may_be_damaged(
    tmp_path: Path, torn: tuple[int, ...], frames: tuple[int, int] | None
) -> None:
    path = tmp_path / "calm.mp4"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*"mp4v"), FPS, CAMERAS[0].size)
    coarse = np.random.default_rng(1).integers(0, 255, (12, 16, 3)).astype(np.uint8)
    picture = cv2.resize(coarse, CAMERAS[0].size, interpolation=cv2.INTER_CUBIC)
    for f in range(FRAMES):
        writer.write(np.roll(picture, f, axis=1))
    writer.release()
    assert whole_pictures(path, FRAMES).tolist() == [0, 12]
    [found] = shot_damage(shot(path), [torn], reported=False)
    assert (found and found.frames) == frames
    if found is not None:
        assert f"between frames {found.frames[0]} and 11 of the file" in found.text
        assert "cut there to another picture" in found.text  # which looks the same


@pytest.mark.parametrize(("lit", "found"), [(True, False), (False, True)])
def test_light_that_changes_where_a_picture_is_stored_whole_is_not_damage(
    tmp_path: Path, lit: bool, found: bool
) -> None:
    path, size = tmp_path / "light.mp4", CAMERAS[0].size
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*"mp4v"), FPS, size)
    coarse = np.random.default_rng(1).integers(60, 200, (12, 16, 3)).astype(np.uint8)
    picture = cv2.resize(coarse, size, interpolation=cv2.INTER_CUBIC)
    flare = 50 * np.exp(-(((np.arange(size[0]) - 0.4 * size[0]) / (0.3 * size[0])) ** 2))[:, None]
    for f in range(FRAMES):
        other = np.clip(picture + flare, 0, 255).astype(np.uint8) if lit else np.roll(picture, 70, axis=1)
        writer.write(picture if f < 12 else other)
    writer.release()
    assert whole_pictures(path, FRAMES).tolist() == [0, 12]
    assert (shot_damage(shot(path), [(12,)], reported=False) != (None,)) == found


def test_damage_is_put_down_to_its_view_and_frame(film: Path, damaged: Path) -> None:
    whole, found = shot_damage(shot(film, damaged))
    assert whole is None
    assert found is not None
    assert found.frames == (DAMAGED,)
    assert found.said in found.text
    assert str(found.frames[0]) in found.text


def test_damage_after_the_shot_does_not_count(damaged: Path) -> None:
    made = shot(damaged)
    early = replace(made, frames=(0, DAMAGED - 1), performers=())
    assert footage_damage(early, early.views[0]) is None


def test_a_decoder_message_is_caught_whichever_thread_decodes(damaged: Path) -> None:
    video = cv2.VideoCapture(str(damaged), cv2.CAP_FFMPEG)
    with DecoderLog() as log:
        while video.grab():
            pass
        video.release()
    assert log.complaints


def test_only_the_decoder_is_kept_from_the_standard_error(capfd: pytest.CaptureFixture[str]) -> None:
    with DecoderLog() as log:
        os.write(2, b"somebody else's words\n[h264 @ 0x55d0c0] error while decoding MB 1 2\n")
        print("Python's", file=sys.stderr)
    os.write(2, b"afterwards\n")
    assert log.complaints == ["error while decoding MB 1 2"]
    said = capfd.readouterr().err
    assert sorted(said.split("\n")) == ["", "Python's", "afterwards", "somebody else's words"]


def test_one_log_within_another_hears_for_itself() -> None:
    with DecoderLog() as outer:
        with DecoderLog() as inner:
            os.write(2, b"[h264 @ 0x55d0c0] Reference 4 >= 4\n")
        os.write(2, b"[NULL @ 0x55d0c0] missing picture\n")
    assert inner.complaints == ["Reference 4 >= 4"]
    assert outer.complaints == ["missing picture"]
