"""A shot that was built in Python is refused before it is tracked if a value of it cannot be true."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from kfmocap.core.body.motion import Motion
from kfmocap.core.errors import ShotError
from kfmocap.core.shot.shot import KeyPoses, Performer, Shot, View
from kfmocap.core.tracking.tracker import track
from synthetic import at_rest, figure, look_at

BODY = figure()
VIEW = View(look_at("cam01", (4, 0, 1), (0, 0, 1)), Path("cam01.mp4"))


def performer(frames: list[int], poses: Motion | None = None) -> Performer:
    return Performer("man", BODY, KeyPoses.whole(frames, at_rest(BODY, 2) if poses is None else poses))


SHOT = Shot("made", 30.0, (0, 9), (VIEW,), (performer([0, 9]),))


def with_view(**change: object) -> Shot:
    return replace(SHOT, views=(replace(VIEW, **change),))


def with_poses(change: Callable[[Motion], Motion]) -> Shot:
    return replace(SHOT, performers=(performer([0, 9], change(at_rest(BODY, 2))),))


@pytest.mark.parametrize("frames", [[0.5, 9], [np.nan, 9], np.arange(2) == 0, ["0", "9"]])
def test_key_frames_that_are_no_frame_numbers_are_refused_where_they_are_given(frames) -> None:
    with pytest.raises(ShotError, match=r"key frames are .* frame numbers, which are whole"):
        KeyPoses.whole(frames, at_rest(BODY, 2))


def test_whole_numbers_of_any_type_are_key_frames() -> None:
    assert KeyPoses.whole(np.array([0.0, 9.0]), at_rest(BODY, 2)).frames.dtype == np.int64


@pytest.mark.parametrize(
    ("shot", "message"),
    [
        (replace(SHOT, fps=np.nan), "shot made: fps is nan"),
        (replace(SHOT, frames=(0.0, 9.0)), r"shot made: frames is \(0\.0, 9\.0\)"),
        (replace(SHOT, views=()), "shot made: there is no view"),
        (replace(SHOT, performers=()), "shot made: there is no performer"),
        (replace(SHOT, views=(VIEW, VIEW)), "there are two views 'cam01'"),
        (with_view(footage="cam01.mp4"), "view cam01: footage is 'cam01.mp4'.*pathlib"),
        (with_view(offset=np.inf), "view cam01: offset is inf"),
        (with_view(every=0), "view cam01: every is 0"),
        (with_view(fields="odd"), "view cam01: fields is 'odd'.*top-first"),
        (replace(SHOT, performers=(performer([0, 5, 9]),)), "performer man: 3 key frames, .*a pose of the body's"),
        (replace(SHOT, performers=(performer([9, 0]),)), "performer man: its key frames are 9, 0 .* 0 to 9"),
        (replace(SHOT, performers=(performer([0, 10]),)), "performer man: its key frames are 0, 10 .* 0 to 9"),
        (with_poses(lambda m: replace(m, rotations=2 * m.rotations)), "key pose on frame 0"),
        (with_poses(lambda m: replace(m, rotations=-m.rotations)), "key pose on frame 0 .*mirror"),
        (
            with_poses(lambda m: replace(m, translations=m.translations * [[1], [np.nan]])),
            "man: its key pose on frame 9",
        ),
        (with_poses(lambda m: replace(m, rotations=m.rotations[:, 1:])), "performer man: 2 key frames, but"),
    ],
)
def test_the_error_names_what_cannot_be_true(shot: Shot, message: str) -> None:
    with pytest.raises(ShotError, match=message):
        track(shot)
