"""Pictures of damaged footage get no weight, whether the decoder tells of the damage or the pictures show it."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import replace
from functools import cache
from pathlib import Path

import cv2
import numpy as np
import pytest
from kfmocap.core.body.kinematics import part_poses, tip_positions
from kfmocap.core.runtime.processes.worker_memory import WorkerMemory
from kfmocap.core.shot.footage_faults.footage_times import whole_pictures
from kfmocap.core.shot.settings import Settings
from kfmocap.core.shot.shot import Shot, View
from kfmocap.core.tracking import tracker
from kfmocap.core.tracking.footage_corrections.damaged_footage import decoder_messages
from kfmocap.core.tracking.footage_reading.frames_ahead import FramesAhead, remember_ahead
from kfmocap.core.tracking.results.track_result import TrackResult
from kfmocap.core.tracking.retracking import Excerpt, track_excerpts
from kfmocap.core.tracking.scheduling.run_context import RunContext
from kfmocap.core.tracking.tracker import track
from late_footage import BODY, CAMERAS, FRAMES, LENGTH, TRUTH, pictures
from synthetic import shot_of

FIRST, WHOLE = 5, 12
"""The first damaged frame of the view at the side, and the next that is stored whole."""
SIDE = 1
KEYS = (0, WHOLE, LENGTH - 1)
SETTINGS = Settings(limb_search=False)


@cache
def in_colour(name: str) -> list[np.ndarray]:
    """What a camera shows; nobody changes it."""
    return [cv2.cvtColor(grey, cv2.COLOR_GRAY2BGR) for grey in pictures(name)[:LENGTH]]


def video(path: Path, frames: list[np.ndarray]) -> Path:
    path.parent.mkdir(exist_ok=True)
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*"mp4v"), 30.0, frames[0].shape[1::-1])
    for frame in frames:
        writer.write(frame)
    writer.release()
    return path


def spoilt(frames: list[np.ndarray], seed: int) -> list[np.ndarray]:
    """Pictures that show something else in their middle, up to the next that is stored whole."""
    height, width = frames[0].shape[:2]
    blocks = np.random.default_rng(seed).integers(0, 255, (9, 12, 3)).astype(np.uint8)
    patch = cv2.resize(blocks, (width // 2, height // 2), interpolation=cv2.INTER_NEAREST)
    found = [frame.copy() for frame in frames]
    for frame in found[FIRST:WHOLE]:
        frame[height // 4 : height // 4 + patch.shape[0], width // 4 : width // 4 + patch.shape[1]] = patch
    return found


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Shot:
    home = tmp_path_factory.mktemp("film")
    views = [View(CAMERAS[name], video(home / f"{name}.mp4", in_colour(name))) for name in CAMERAS]
    assert whole_pictures(views[SIDE].footage, LENGTH).tolist() == [0, WHOLE]
    return shot_of(views, [BODY], [TRUTH[FRAMES]], KEYS, SETTINGS)


def of_side(shot: Shot, path: Path) -> Shot:
    """The shot with other footage of the view at the side."""
    return replace(shot, views=tuple(replace(v, footage=path) if i == SIDE else v for i, v in enumerate(shot.views)))


@pytest.fixture(scope="module")
def shown(whole: Shot, tmp_path_factory: pytest.TempPathFactory) -> Shot:
    """A shot with damaged pictures of which the decoder says nothing."""
    return of_side(whole, video(tmp_path_factory.mktemp("shown") / "side.mp4", spoilt(in_colour("side"), 1)))


@pytest.fixture(scope="module")
def told(whole: Shot, tmp_path_factory: pytest.TempPathFactory) -> Shot:
    """A shot with a run of zeros in one frame of a file."""
    path = whole.views[SIDE].footage
    data, reading = bytearray(path.read_bytes()), cv2.VideoCapture(str(path), cv2.CAP_FFMPEG, [cv2.CAP_PROP_FORMAT, -1])
    packets = [reading.read()[1].tobytes() for _ in range(LENGTH)]
    reading.release()
    middle = data.index(packets[FIRST]) + len(packets[FIRST]) // 3
    data[middle : middle + 48] = bytes(48)
    damaged = tmp_path_factory.mktemp("told") / "damaged.mp4"
    damaged.write_bytes(data)
    return of_side(whole, damaged)


@pytest.fixture(scope="module")
def remembered(told: Shot) -> Iterator[tuple[WorkerMemory, TrackResult]]:
    """The result of the shot of which the decoder tells, and the memory with its pictures."""
    memory = WorkerMemory()
    yield memory, track(told, run=RunContext(memory=memory))
    memory.close()


def known(shot: Shot) -> Shot:
    """The shot with what is damaged given."""
    views = [replace(v, damaged=((FIRST, WHOLE - 1),)) if i == SIDE else v for i, v in enumerate(shot.views)]
    return replace(shot, views=tuple(views))


def error(result: TrackResult) -> float:
    """Mean distance of the tips of all parts from their true places on the damaged frames, mm."""
    found, true = (tip_positions(BODY, part_poses(BODY, motion)) for motion in (result.motions[0], TRUTH[FRAMES]))
    return 1000 * float(np.linalg.norm(found - true, axis=-1)[FIRST:WHOLE].mean())


def stretches(result: TrackResult) -> tuple[tuple[int, int], ...]:
    assert [own is not None for own in result.damage] == [v == SIDE for v in range(len(CAMERAS))]
    own = result.damage[SIDE]
    assert own is not None
    return own.stretches


@pytest.mark.parametrize(("first", "keys"), [(FIRST, KEYS), (0, (0, FIRST + 2, LENGTH - 1))])
def test_what_damaged_pictures_show_changes_nothing(tmp_path: Path, first: int, keys: tuple[int, ...]) -> None:
    def tracked(name: str, side: list[np.ndarray]) -> TrackResult:
        views = []
        for camera in CAMERAS:
            (tmp_path / name / camera).mkdir(parents=True)
            for f, image in enumerate(side if camera == "side" else in_colour(camera)):
                cv2.imwrite(str(tmp_path / name / camera / f"{f:03d}.png"), image)
            views.append(View(CAMERAS[camera], tmp_path / name / camera / "%03d.png"))
        views[SIDE] = replace(views[SIDE], damaged=((first, WHOLE - 1),))
        return track(shot_of(views, [BODY], [TRUTH[FRAMES]], keys, SETTINGS))

    spoilt_one, whole_one = tracked("spoilt", spoilt(in_colour("side"), 2)), tracked("whole", in_colour("side"))
    assert spoilt_one.motions[0].rotations.tobytes() == whole_one.motions[0].rotations.tobytes()
    assert spoilt_one.errors[0].deviation.tobytes() == whole_one.errors[0].deviation.tobytes()
    assert spoilt_one.torn[SIDE] == whole_one.torn[SIDE] == ()


def test_damage_that_only_the_pictures_show_gets_no_weight(shown: Shot, monkeypatch: pytest.MonkeyPatch) -> None:
    result = track(shown)
    assert stretches(result) == ((FIRST, WHOLE - 1),)
    assert result.motions[0].rotations.tobytes() == track(known(shown)).motions[0].rotations.tobytes()
    monkeypatch.setattr(tracker, "without_damaged", lambda shot, _: shot)
    assert error(result) < 0.6 * error(track(shown)), "the other views show the motion meanwhile"


def test_damage_that_the_decoder_tells_gets_no_weight(told: Shot, remembered: tuple[WorkerMemory, TrackResult]) -> None:
    _, result = remembered
    assert stretches(result) == ((FIRST, WHOLE - 1),)
    assert result.motions[0].rotations.tobytes() == track(known(told)).motions[0].rotations.tobytes()


def test_one_view_by_itself_keeps_its_weight_and_says_so(shown: Shot) -> None:
    alone = replace(shown, views=shown.views[SIDE : SIDE + 1])
    [damage] = track(alone).damage
    assert damage is not None and damage.stretches == ((FIRST, WHOLE - 1),)
    assert "they have weight and may mislead the tracking" in damage.text


def test_whole_footage_is_not_damaged(whole: Shot) -> None:
    assert track(whole).damage == ()


def test_pictures_in_memory_are_known_to_be_damaged(told: Shot, remembered: tuple[WorkerMemory, TrackResult]) -> None:
    memory, first = remembered
    again = track(told, run=RunContext(memory=memory))
    assert stretches(first) == stretches(again)
    assert again.motions[0].rotations.tobytes() == first.motions[0].rotations.tobytes()
    [part] = track_excerpts(told, [Excerpt(0, WHOLE, footage_offset=0.0)], run=RunContext(memory=memory))
    assert stretches(part) == stretches(first)


def test_what_decoders_say_in_a_run_that_is_ended_counts_for_the_next(told: Shot) -> None:
    memory = WorkerMemory()
    with pytest.raises(InterruptedError):
        track(told, observe=_interrupted, run=RunContext(memory=memory))
    assert stretches(track(told, run=RunContext(memory=memory))) == ((FIRST, WHOLE - 1),)
    memory.close()


def test_what_decoders_say_while_frames_are_decoded_ahead_counts(told: Shot) -> None:
    memory, ahead = WorkerMemory(limit=0), FramesAhead(told.frames, (), SETTINGS)
    with decoder_messages(memory), ahead.decoding(told.views):
        while not ahead.done:
            time.sleep(0.01)
    remember_ahead(memory, ahead)
    assert stretches(track(told, run=RunContext(memory=memory))) == ((FIRST, WHOLE - 1),)
    memory.close()


def _interrupted(*_: object) -> None:
    raise InterruptedError
