"""The benchmark measures what it says: each case alone, errors against the reference, gaps named and not hidden."""

from __future__ import annotations

import json
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import ROOT
from kfmocap.__main__ import main
from kfmocap.benchmarks import bench, tables
from kfmocap.benchmarks.measured_case import Watch
from kfmocap.benchmarks.rows import CONVERGENCE, ROWS, SWEEPS, Case, Row, cases
from kfmocap.core.body import human
from kfmocap.core.body.motion import Motion
from kfmocap.core.choices import SOLVERS
from kfmocap.core.errors import FootageError
from kfmocap.core.shot.settings import Settings
from kfmocap.core.shot.shot import KeyPoses, Performer
from short_walk import short_walk

WALK = ROOT / "examples" / "walk"


def measured(mean: float = 12.34, blender: float | None = 56.0, **more: Any) -> dict[str, Any]:
    """What a case reports."""
    return {
        "score": {"mean": mean},
        "spline": 45.0,
        "blender": blender,
        "way": None,
        "seconds": {"load": 1.0, "solve": 2.0, "total": 4.0},
        "camera_frames": 100,
        "iterations": [8, 10],
        "memory": 200_000_000,
        **more,
    }


@pytest.fixture
def stand_in(monkeypatch: pytest.MonkeyPatch) -> list[Case]:
    """Cases are noted instead of tracked."""
    seen: list[Case] = []

    def alone(case: Case, _folder: Path) -> dict[str, Any]:
        seen.append(case)
        way = [20.0, 15.0, 12.34] if case.watch else None
        iterations = [case.sweeps or 500] if case.solver == "relaxation" else [8, 10]
        return measured(way=way, before_last=20.0, iterations=iterations)

    monkeypatch.setattr(bench, "measured_alone", alone)
    monkeypatch.setattr(bench, "example_folder", lambda name: ROOT / "examples" / name)
    return seen


@pytest.mark.parametrize("row", ROWS, ids=str)
def test_rows_name_cameras_and_frames_of_their_shot(row: Row) -> None:
    file = "shot_keypoints.toml" if row.keypoints else "shot.toml"
    shot = tomllib.loads((ROOT / "examples" / row.shot / file).read_text())
    assert set(row.cameras) <= {view["camera"] for view in shot["view"] if not row.keypoints or "keypoints" in view}
    assert all(shot["shot"]["frames"][0] <= key <= shot["shot"]["frames"][1] for key in row.keyframes)
    assert row.keyframes or row.keypoints


def test_every_row_is_solved_by_every_solver_that_uses_what_it_gives() -> None:
    default = [case for case in cases() if case.sweeps is None]
    wanted = {(row, solver) for row in ROWS for solver in SOLVERS if solver == "gauss-newton" or not row.keypoints}
    assert {(case.row, case.solver) for case in default} == wanted
    assert all(case.row.shot == "walk" for case in cases("walk"))
    assert {case.row.shot for case in cases(quick=True)} == {"beam", "walk"}
    assert len(cases(quick=True)) < len(cases()) / 2


def test_the_last_sweeps_are_the_default() -> None:
    assert SWEEPS[-1] == Settings().sweeps
    assert CONVERGENCE in ROWS


def test_a_table_is_markdown_with_numbers_to_the_right() -> None:
    table = tables.markdown(("name", "mm"), [("a", "7.5"), ("bcdef", "-"), ("", "120.0")])
    assert table.splitlines() == [
        "| name  |    mm |",
        "| ----- | ----: |",
        "| a     |   7.5 |",
        "| bcdef |     - |",
        "|       | 120.0 |",
    ]


def test_the_way_joins_segments_by_their_iterations() -> None:
    def motion(values: list[float]) -> Motion:
        return Motion(np.array(values)[:, None] * np.ones(3), np.tile(np.eye(3), (len(values), 2, 1, 1)))

    watch = Watch()
    watch((0, 2), 0, [motion([0, 1, 1])])
    watch((0, 2), 1, [motion([0, 2, 2])])
    watch((2, 3), 0, [motion([2, 5])])
    end = motion([0, 3, 3, 6])
    way = [m.translations[:, 0].tolist() for m in watch.way(end)]
    assert way == [[0, 1, 2, 5], [0, 2, 2, 6], [0, 3, 3, 6]]
    assert watch.before_last(end).translations[:, 0].tolist() == [0, 2, 2, 5]


def test_tables_and_values_are_written(
    stand_in: list[Case], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["bench", "--out", str(tmp_path / "out")]) == 0
    assert stand_in == cases()
    printed = capsys.readouterr().out
    assert printed == (tmp_path / "out" / "bench.md").read_text()
    assert "| 0 33 66 99            |         12.3 |       12.3 |             56.0 |   45.0 |" in printed
    written = json.loads((tmp_path / "out" / "bench.json").read_text())["cases"]
    assert [result["solver"] for result in written[:2]] == [*SOLVERS]
    ways = printed[printed.index("Gauss-Newton iterations") :].splitlines()[2:]
    cells = [[cell.strip() for cell in line.strip("|").split("|")] for line in ways]
    assert [row[:2] for row in cells] == [["0", "20.0"], ["1", "15.0"], ["2", "12.3"], ["", ""]]
    assert [row[2] for row in cells] == ["0", *map(str, SWEEPS)]


def test_of_many_iterations_the_first_every_tenth_and_the_last_are_shown() -> None:
    def shown(count: int) -> list[str]:
        table = tables.convergence([{"solver": "gauss-newton", "way": [float(i) for i in range(count)]}])
        return [line.split("|")[1].strip() for line in table.splitlines()[2:]]

    assert shown(5) == ["0", "1", "2", "3", "4"]
    assert shown(24) == ["0", "1", "2", "3", "10", "20", "23"]


def test_times_are_medians_of_runs(monkeypatch: pytest.MonkeyPatch) -> None:
    runs = iter([measured(seconds={"total": t}, memory=m) for t, m in ((9.0, 1), (3.0, 5), (4.0, 2))])
    monkeypatch.setattr(bench, "measured_alone", lambda *_: next(runs))
    [result] = bench.measured([(Case(Row("walk", ("cam01",), (0,)), "relaxation"), WALK)], 3)
    assert result["seconds"] == {"total": 4.0} and result["memory"] == 2


def test_a_shot_without_footage_is_left_out_and_named(
    stand_in: list[Case], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def folder(name: str) -> Path:
        if name == "beam":
            raise FootageError("no network", where="package")
        return WALK

    monkeypatch.setattr(bench, "example_folder", folder)
    assert main(["bench"]) == 0
    assert {case.row.shot for case in stand_in} == {"walk"}
    captured = capsys.readouterr()
    assert captured.err.count("beam is left out") == 1 and "no network" in captured.err
    assert "beam" not in captured.out
    assert main(["bench", "--shot", "beam"]) == 1


def test_a_failed_case_is_a_dash_and_an_exit_code(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(bench, "example_folder", lambda name: WALK)

    def alone(case: Case, _folder: Path) -> dict[str, Any]:
        return {"error": "it broke"} if case.solver == "relaxation" else measured(blender=None)

    monkeypatch.setattr(bench, "measured_alone", alone)
    assert main(["bench", "--quick", "--shot", "walk"]) == 1
    captured = capsys.readouterr()
    assert "it broke" in captured.err
    assert "|         12.3 |          - |                - |   45.0 |" in captured.out


@pytest.mark.parametrize("wrong", [["--shot", "talk"], ["--repeat", "0"]])
def test_wrong_options_are_named(wrong: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["bench", *wrong]) == 1
    assert f"{wrong[0]}: " in capsys.readouterr().err


def test_a_case_is_measured_in_a_process_of_its_own(tmp_path: Path) -> None:
    folder = short_walk(tmp_path / "walk", 12)
    result = bench.measured_alone(Case(Row("walk", ("cam02",), (0, 6, 11)), "gauss-newton", watch=True), folder)
    assert "error" not in result, result
    assert result["score"]["frames"] == 9
    assert result["score"]["mean"] < result["spline"]
    assert result["way"][0] == pytest.approx(result["spline"])
    assert result["way"][-1] == pytest.approx(result["score"]["mean"])
    assert result["camera_frames"] == 12 and result["seconds"]["total"] > result["seconds"]["solve"] > 0
    assert result["memory"] is None or 5e7 < result["memory"] < 2e9
    assert len(result["iterations"]) == 2


def test_what_a_case_cannot_do_is_its_error(tmp_path: Path) -> None:
    result = bench.measured_alone(Case(Row("walk", ("cam01",), (0,)), "gauss-newton"), tmp_path)
    assert "the shot file cannot be read" in result["error"]


@pytest.mark.blender
def test_blenders_curves_meet_the_key_poses_and_do_not_overshoot() -> None:
    from kfmocap.benchmarks.blender_curves import interpolated
    from kfmocap.core.numerics import rotations

    body = human()
    Q = np.tile(np.eye(3), (3, len(body), 1, 1))
    Q[1:, body.index("upper_arm.R")] = rotations.exp(np.array([0, 0.5, 0.8]))
    poses = Motion(np.array([[0.0, 0, 1], [0.5, 0, 1], [0.5, 0.2, 1]]), Q)
    motion = interpolated(Performer("man", body, KeyPoses.whole([0, 10, 25], poses)), 30)
    assert len(motion) == 30
    assert np.abs(motion[[0, 10, 25]].difference(poses)).max() < 1e-5
    np.testing.assert_allclose(motion.translations[10:, 0], 0.5, atol=1e-5)
    assert 0.1 < motion.translations[5, 0] < 0.4
