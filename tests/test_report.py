"""The report and the joint error say what happened."""

from __future__ import annotations

import json
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from kfmocap.core.body import human
from kfmocap.core.cameras import Camera
from kfmocap.core.errors import LandmarkError
from kfmocap.core.formats import Landmarks
from kfmocap.core.motion import Motion
from kfmocap.core.report import intervals, report, write_report
from kfmocap.core.scoring import joint_error
from kfmocap.core.shot import KeyPoses, Performer, Shot, View


@given(st.lists(st.booleans(), max_size=30), st.integers(0, 50))
def test_intervals_cover_the_true_frames_and_no_others(mask: list[bool], first: int) -> None:
    spans = intervals(np.array(mask, dtype=bool), first)
    covered = {f for a, b in spans for f in range(a, b + 1)}
    assert covered == {first + i for i, value in enumerate(mask) if value}
    assert all(b + 1 < a for (_, b), (a, _) in pairwise(spans))


@dataclass
class Segment:
    first: int
    last: int
    iterations: int
    energy: tuple[float, ...]


def test_the_report_counts_frames_as_the_footage_does(tmp_path: Path) -> None:
    body, F = human(), 8
    motion = Motion(np.zeros((F, 3)), np.tile(np.eye(3), (F, len(body), 1, 1)))
    camera = Camera.create("cam01", (64, 48), [[60, 0, 31], [0, 60, 23], [0, 0, 1]], np.eye(3), np.zeros(3))
    performer = Performer("man", body, KeyPoses.whole([0, 7], motion[[0, 7]]))
    shot = Shot("jump", 25.0, (100, 107), (View(camera, Path("a.mp4")),), (performer,))
    visible = np.ones((1, F, len(body)))
    visible[0, 2:5, body.index("forearm.R")] = 0.1
    residual = np.zeros(F)
    residual[6] = 0.2
    residual[0] = np.nan

    class Result:
        seconds = {"footage": 1.0, "solve": 3.0}
        camera_frames = F
        segments = (Segment(0, 7, 3, (5.0, 2.0, 1.5)),)

    Result.visible, Result.residual = (visible,), (residual,)
    values = report(shot, Result(), {"overlay": 0.5})
    assert values["camera_frames_per_second"] == 2.0
    assert values["seconds_total"] == 4.5
    assert values["segments"] == [{"frames": [100, 107], "iterations": 3, "energy": [5.0, 2.0, 1.5]}]
    (man,) = values["performers"]
    assert man["keyframes"] == [100, 107]
    assert man["occluded"] == {"cam01": {"forearm.R": [[102, 104]]}}
    assert man["worst_frames"][0] == {"frame": 106, "residual": 0.2}
    assert 100 not in [w["frame"] for w in man["worst_frames"]]
    write_report(tmp_path / "report.json", values)
    assert json.loads((tmp_path / "report.json").read_text()) == values


def landmarks(names: list[str], points: np.ndarray) -> Landmarks:
    return Landmarks(tuple(names), points, 30.0)


def test_joint_error_leaves_out_key_frames_and_what_is_no_joint() -> None:
    names = ["Hip", "RHip", "LKnee", "Nose"]
    truth = np.zeros((5, 4, 3))
    found = truth.copy()
    found[:, 1, 0] = 0.010
    found[:, 2, 1] = 0.030
    found[:, [0, 3]] = 9.0
    found[[0, 4]] = 5.0
    score = joint_error(landmarks(names, found), landmarks(names, truth), [0, 4])
    assert score.frames == 3
    assert score.mean == pytest.approx(20.0)
    assert score.per_landmark == pytest.approx({"RHip": 10.0, "LKnee": 30.0})


def test_nothing_to_compare_is_an_error() -> None:
    with pytest.raises(LandmarkError, match="share no joint"):
        joint_error(landmarks(["Nose"], np.zeros((3, 1, 3))), landmarks(["Nose"], np.zeros((3, 1, 3))), [])
