"""The times that are measured: of the whole command with all of its processes, and of rows that say what they vary."""

from __future__ import annotations

import tomllib
from pathlib import Path

import cv2
import numpy as np
import pytest
from kfmocap.benchmarks import long_shots, speed
from kfmocap.benchmarks.command_cost import Cost, command_cost
from kfmocap.benchmarks.speed import SpeedRow
from kfmocap.core.errors import KFMocapError

STAND_IN = """
import subprocess, sys
work = "n = sum(range(6_000_000)); data = bytearray(30_000_000)"
raise SystemExit(subprocess.run([sys.executable, "-c", work]).returncode if "good" in sys.argv[2] else "it does not go")
"""


@pytest.fixture
def program(tmp_path: Path) -> Path:
    """A program in whose place another process works."""
    (tmp_path / "kfmocap").mkdir()
    (tmp_path / "kfmocap" / "__main__.py").write_text(STAND_IN)
    return tmp_path


def test_what_the_processes_of_a_command_take_counts(program: Path) -> None:
    folder = program / "good"
    folder.mkdir()
    (folder / "shot.toml").write_text("[shot]\n")
    cost = command_cost(program, folder / "shot.toml", ["cam01"], 3)
    assert 0.05 < cost.processor < 30 and cost.seconds > 0.05
    assert "threads = 3" in (folder / "cores3.toml").read_text()


def test_key_poses_at_the_ends_are_the_first_and_the_last(tmp_path: Path) -> None:
    (tmp_path / "shot.toml").write_text("keyframes = [0, 33, 66, 399]\n")
    kept, alone = (long_shots.threads_text(tmp_path / "shot.toml", 1, ends=ends).read_text() for ends in (False, True))
    assert "[0, 33, 66, 399]" in kept and "keyframes = [0, 399]\n" in alone
    assert not tomllib.loads(alone)["track"]["correct_gaps"]


def test_a_command_that_fails_is_not_measured(program: Path) -> None:
    (program / "shot.toml").write_text("[shot]\n")
    with pytest.raises(KFMocapError, match="it does not go"):
        command_cost(program, program / "shot.toml", ["cam01"], 1)


def test_footage_played_forwards_and_backwards_shows_no_frame_twice_in_a_row() -> None:
    assert long_shots.back_and_forth(4, 9).tolist() == [0, 1, 2, 3, 2, 1, 0, 1, 2]


def test_a_long_shot_turns_back_on_no_key_frame() -> None:
    """It would seem that limbs were lost there, and the search for them would be what is measured."""
    order = long_shots.back_and_forth(100, 1000, long_shots.TURN_MARGIN)
    turns = 1 + np.flatnonzero(np.diff(order, 2))
    assert len(turns) > 10
    assert not (turns % long_shots.KEY_EVERY == 0).any()


def test_frames_cameras_performers_and_cores_are_varied_one_at_a_time() -> None:
    every = speed.speed_rows(4, quick=False)
    assert len(set(every)) == len(every)
    rows = [row for row in every if not row.crossing]
    assert {row.frames for row in rows if (row.cameras, row.threads) == (4, 4)} == {34, 100, 400, 1000, 3000}
    assert {row.cameras for row in rows if (row.frames, row.threads) == (100, 4)} == {1, 2, 4}
    assert {row.threads for row in rows if (row.frames, row.cameras) == (400, 4)} == {1, 2, 4}
    assert [(row.frames, row.cameras) for row in rows if row.ends] == [(400, 2)]
    crossing = [row for row in every if row.crossing]
    assert [row.crossing for row in crossing] == [1, 2, 4]
    assert len({(row.frames, row.cameras, row.threads) for row in crossing}) == 1


def test_the_table_says_how_many_times_as_fast_it_is_as_the_other_version() -> None:
    rows = [SpeedRow(100, 4, 2), SpeedRow(100, 1, 2)]
    found = [(Cost(4.0, 6.0, 0), Cost(10.0, 12.0, 0)), (Cost(2.0, 3.0, 10**9), Cost(3.0, 4.0, 0))]
    lines = speed.table(rows, found).splitlines()
    assert lines[0].split("|")[-2].strip() == "times as fast"
    assert [cell.strip() for cell in lines[2].split("|")[1:-1]] == [
        "100",
        "every 33",
        "4",
        "1",
        "2",
        "4.0",
        "6.0",
        "100",
        "-",
        "2.50",
    ]
    assert "1000" in lines[3] and "1.50" in lines[3]


@pytest.mark.parametrize(("quick", "charts"), [(True, 3), (False, 4)])
def test_the_plot_has_a_chart_for_each_number_that_is_varied(tmp_path: Path, quick: bool, charts: int) -> None:
    rows = speed.speed_rows(2, quick=quick)
    speed.write_plot(tmp_path / "speed.png", rows, [Cost(row.frames * 0.1, 1.0, 0) for row in rows])
    assert charts * 200 < cv2.imread(str(tmp_path / "speed.png")).shape[0] < (charts + 1) * 290
