"""A shot of six small pictures, tracked on the command line by a stand-in for the tracker."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from kfmocap.__main__ import main
from kfmocap.core.body.motion import Motion
from kfmocap.core.numerics import rotations
from kfmocap.core.shot.shot import Shot
from kfmocap.core.tracking.expected_errors.uncertainty import JointErrors
from kfmocap.core.tracking.results.track_result import TrackResult

SIZE = (96, 72)
FRAMES = 6
SHOT = """
[shot]
name = "tiny"
fps = 30.0
frames = [0, 5]

[calibration]
file = "calibration.toml"

[[view]]
camera = "cam01"
footage = "footage_%02d.png"

[[performer]]
name = "man"
landmarks = "landmarks.trc"
keyframes = [0, 5]
"""


def motion_of(body, frames: int = FRAMES) -> Motion:
    Q = np.tile(np.eye(3), (frames, len(body), 1, 1))
    Q[:, body.index("upper_arm.R")] = rotations.exp(np.linspace([0, 0, 0], [0, 0.5, 0.8], frames))
    return Motion(np.linspace([0, 0, 1], [0.3, 0, 1], frames), Q)


def made_result(shot: Shot) -> TrackResult:
    """What the tracker hands back, without its work."""
    counts = [(len(shot.views), shot.length, len(p.body)) for p in shot.performers]
    return TrackResult(
        motions=tuple(motion_of(p.body) for p in shot.performers),
        seconds={"footage": 1.0, "solve": 3.0},
        camera_frames=len(shot.views) * shot.length,
        segments=(),
        visible=tuple(np.ones(count) for count in counts),
        residual=tuple(np.linspace(0, 0.1, shot.length) for _ in shot.performers),
        errors=tuple(JointErrors(*np.zeros((3, *count[1:]))) for count in counts),
        unknown=tuple(() for _ in shot.performers),
    )


def track(folder: Path, *arguments: str, out: str = "out") -> int:
    return main(["track", str(folder / "shot.toml"), "--out", str(folder / out), "--no-blender", *arguments])


def assert_refused(folder: Path, capsys: pytest.CaptureFixture[str], code: int, *words: str) -> None:
    """One line on standard error with these words, and the output folder as it was."""
    captured = capsys.readouterr()
    assert code == 1
    assert captured.out == ""
    assert captured.err.startswith("kfmocap: error: ")
    assert captured.err.count("\n") == 1
    for word in words:
        assert word in captured.err
    assert [file.name for file in (folder / "out").iterdir()] == ["notes.txt"]
    assert not list(folder.glob(".kfmocap-*"))


def broken(error: BaseException):
    def fail(shot, progress=None, pictures=(), **_):
        raise error

    return fail
