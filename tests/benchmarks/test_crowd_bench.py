"""What performers cost each other: ratios to each of them alone, and what a shot needs to be measured."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from kfmocap.benchmarks.studies import several_performers
from kfmocap.benchmarks.studies.several_performers import TrackedPerformers, main, tracked
from kfmocap.core.body import human
from kfmocap.core.errors import ShotError
from kfmocap.core.shot.shot import KeyPoses, Performer, Shot
from kfmocap.core.shot.shot_spec import PerformerSpec, ShotSpec
from synthetic import at_rest

FRAMES = 5


def spec_of(*names: str, landmarks: Path | None = Path("truth.trc")) -> ShotSpec:
    performers = tuple(PerformerSpec(name, keyframes=(0, 4), landmarks=landmarks, where="here") for name in names)
    return ShotSpec(Path("shot.toml"), "shot", 30.0, (0, FRAMES - 1), Path("c.toml"), (), performers)


def test_errors_and_time_are_compared_with_those_of_each_performer_alone(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    found = {
        "both": TrackedPerformers({"A": 6.0, "B": 9.0, "C": 7.0}, 42.0),
        "a": TrackedPerformers({"A": 4.0}, 10.0),
        "b": TrackedPerformers({"B": 10.0}, 30.0),
    }
    monkeypatch.setattr(several_performers, "read_shot_spec", lambda file: file.stem)
    monkeypatch.setattr(several_performers, "tracked", found.__getitem__)
    assert main(["both.toml", "a.toml", "b.toml"]) == 0
    cells = [[cell.strip() for cell in line.split("|")[1:-1]] for line in capsys.readouterr().out.splitlines()]
    assert cells[2:5] == [["A", "6.0", "4.0", "1.50"], ["B", "9.0", "10.0", "0.90"], ["C", "7.0", "-", "-"]]
    assert main(["both.toml", "a.toml", "b.toml"]) == 0
    assert "2.1 times the 20.0 s of one performer" in capsys.readouterr().out


def test_frames_with_a_key_pose_do_not_count(monkeypatch: pytest.MonkeyPatch) -> None:
    body, motion = human(), at_rest(human(), FRAMES)
    performers = tuple(Performer(name, body, KeyPoses.whole([0, 4], motion[[0, 4]])) for name in "AB")
    shot = Shot("shot", 30.0, (0, FRAMES - 1), (), performers)
    errors = {0: np.array([0.0, 3, 4, 5, 0]), 1: np.array([0.0, 6, 8, 10, 0])}
    monkeypatch.setattr(several_performers, "prepare_shot", lambda _: shot)
    monkeypatch.setattr(several_performers, "track", lambda _: None)
    monkeypatch.setattr(several_performers, "real_errors", lambda _shot, _result, _file, number: errors[number])
    assert tracked(spec_of("A", "B")).errors == {"A": 4.0, "B": 8.0}
    with pytest.raises(ShotError, match="here: it has no truth to compare with"):
        tracked(spec_of("A", "B", landmarks=None))
