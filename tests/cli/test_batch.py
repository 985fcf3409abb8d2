"""Many shots: each ends by itself, what is done is not done again, and the exit code says whether to try again."""

from __future__ import annotations

import csv
import json
import os
import shutil
import signal
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from kfmocap.cli import batch_command
from kfmocap.cli.batch_command import run_batch
from kfmocap.cli.batch_display import BatchDisplay
from kfmocap.cli.batch_outcome import ShotOutcome, ShotState, outcomes
from kfmocap.cli.batch_selection import BatchShot, chosen_shots
from kfmocap.cli.batch_shot import BatchOptions, shot_digest
from kfmocap.cli.batch_summary import write_summary
from kfmocap.cli.command_line import main
from kfmocap.core.errors import FootageError, OutputError, ShotError, WorkerEndedError
from kfmocap.core.runtime.processes.job import Job
from kfmocap.core.shot.fingerprint import file_bytes
from tiny_shot import SHOT

pytest_plugins = ("tiny_shot_fixtures",)

OPTIONS = BatchOptions(None, None, 1)
RESULT = {"expected_error": 12.0, "seconds": 3.0, "warnings": ("frames on which no camera sees a part",)}


class StandInJob:
    """A job whose result is given by the name of its output folder: a value, or an error that is raised."""

    results: dict[str, list[Any]]
    started: list[str]
    ended: list[str]

    def __init__(self, work: Any) -> None:
        self.name = work.args[1].name
        self.state, self.process_id = ("solve", 0.5), 1
        self.started.append(self.name)
        self.done = self.name in self.results

    def result(self) -> Any:
        result = self.results[self.name].pop(0)
        if isinstance(result, BaseException):
            raise result
        return result

    def end(self) -> None:
        self.ended.append(self.name)


@pytest.fixture
def shots(folder: Path, monkeypatch: pytest.MonkeyPatch) -> list[BatchShot]:
    """Three shots on the same footage; no process is started for them."""
    (folder / "shots").mkdir()
    for name in "abc":
        text = SHOT.replace('"tiny"', f'"{name}"')
        for file in ("calibration.toml", "footage_%02d.png", "landmarks.trc"):
            text = text.replace(file, f"../{file}")
        (folder / "shots" / f"{name}.toml").write_text(text)
    monkeypatch.setattr(batch_command, "Job", StandInJob)
    monkeypatch.setattr(batch_command, "_POLL", 0.0)
    StandInJob.results = {name: [RESULT] for name in "abc"}
    StandInJob.started, StandInJob.ended = [], []
    return chosen_shots([str(folder / "shots" / "*.toml")])


def states(found: list[ShotOutcome]) -> dict[str, str]:
    return {outcome.name: outcome.state for outcome in found}


def with_results(out: Path, found: list[ShotOutcome]) -> None:
    """Stand in for the results of the shots that are done."""
    for outcome in found:
        (out / outcome.name).mkdir(exist_ok=True)
        (out / outcome.name / "report.json").touch()


def test_a_shot_that_fails_harms_no_other(shots: list[BatchShot], tmp_path: Path) -> None:
    StandInJob.results |= {"a": [ZeroDivisionError("a bug")], "b": [FootageError("it breaks off", where="b.mp4")]}
    found = run_batch(shots, tmp_path / "results", OPTIONS, jobs=2)
    assert states(found) == {"a": ShotState.FAILED, "b": ShotState.REFUSED, "c": ShotState.DONE}
    messages = {outcome.name: outcome.message for outcome in found}
    assert messages == {"a": "ZeroDivisionError: a bug", "b": "b.mp4: it breaks off", "c": ""}
    assert sorted(outcomes(tmp_path / "results"), key=lambda o: o.name) == sorted(found, key=lambda o: o.name)


@pytest.mark.parametrize(
    ("results", "code", "said"),
    [
        ({}, 0, "3 of 3 shots done"),
        ({"a": ShotError("it is wrong")}, 2, "2 of 3 shots done; bad input: a"),
        (
            {"a": ShotError("it is wrong"), "b": OutputError("the disk is full")},
            1,
            "1 of 3 shots done; bad input: a; failed: b",
        ),
        ({"c": ZeroDivisionError("a bug")}, 1, "2 of 3 shots done; failed: c"),
    ],
)
def test_the_exit_code_says_whether_to_try_again_and_the_last_line_why(
    shots: list[BatchShot],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    results: dict[str, Exception],
    code: int,
    said: str,
) -> None:
    StandInJob.results |= {name: [error] for name, error in results.items()}
    files = [str(shot.file) for shot in shots]
    assert main(["batch", *files, "--out", str(tmp_path / "results"), "--no-blender"]) == code
    assert capsys.readouterr().err.splitlines()[-1] == f"kfmocap: {said}"


def test_what_is_done_is_not_done_again_unless_it_has_changed(shots: list[BatchShot], tmp_path: Path) -> None:
    out = tmp_path / "results"
    StandInJob.results["c"] = [OutputError("the disk is full")]
    with_results(out, run_batch(shots, out, OPTIONS))
    StandInJob.results = {name: [RESULT] for name in "abc"}
    StandInJob.started = []
    shots[0].file.write_text(shots[0].file.read_text().replace("keyframes = [0, 5]", "keyframes = [0, 3, 5]"))
    found = run_batch(shots, out, OPTIONS)
    assert StandInJob.started == ["a", "c"]
    assert states(found) == dict.fromkeys("abc", ShotState.DONE)
    shutil.rmtree(out / "b")
    StandInJob.started = []
    StandInJob.results["b"] = [RESULT]
    run_batch(shots, out, OPTIONS)
    assert StandInJob.started == ["b"]


@pytest.mark.parametrize("file", ["landmarks.trc", "calibration.toml", "footage_03.png"])
def test_results_depend_on_every_file_of_a_shot(shots: list[BatchShot], tmp_path: Path, file: str) -> None:
    before = shot_digest(shots[0].file, OPTIONS)
    assert shot_digest(shots[0].file, OPTIONS) == before
    assert shot_digest(shots[0].file, BatchOptions("relaxation", None, 1)) != before
    assert shot_digest(shots[0].file, BatchOptions(None, None, 8)) == before
    content = bytearray((tmp_path / file).read_bytes())
    content[-1] ^= 1
    (tmp_path / file).write_bytes(content)
    assert shot_digest(shots[0].file, OPTIONS) != before


def test_results_depend_on_the_middle_of_large_footage_too(tmp_path: Path) -> None:
    """A part that was exchanged is longer than what lies between two pieces that are looked at."""
    file = tmp_path / "footage.mp4"
    content = bytearray(12_000_000)
    file.write_bytes(content)
    before = b"".join(file_bytes(file))
    assert len(before) < 5_000_000
    content[6_000_000:6_200_000] = b"x" * 200_000
    file.write_bytes(content)
    assert b"".join(file_bytes(file)) != before


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="there are no named pipes")
def test_a_path_that_is_not_a_file_is_not_waited_for(shots: list[BatchShot], tmp_path: Path) -> None:
    (tmp_path / "footage_03.png").unlink()
    os.mkfifo(tmp_path / "footage_03.png")
    assert shot_digest(shots[0].file, OPTIONS)
    (tmp_path / "endless.mp4").symlink_to("/dev/zero")
    assert len(b"".join(file_bytes(tmp_path / "endless.mp4"))) < 100


@pytest.mark.parametrize("name", ["status", "Summary.csv"])
def test_no_shot_has_the_name_of_what_a_batch_writes(folder: Path, name: str) -> None:
    (folder / "shot.toml").write_text(SHOT.replace('name = "tiny"', f'name = "{name}"'))
    with pytest.raises(ShotError, match=f"'{name}'"):
        chosen_shots([str(folder / "shot.toml")])


def test_an_undecodable_path_is_still_listed_in_the_table(tmp_path: Path) -> None:
    write_summary(
        tmp_path, [ShotOutcome("a", "caf\udce9/shot.toml", ShotState.REFUSED, message="caf\udce9: it breaks off")]
    )
    assert r"caf\udce9/shot.toml" in (tmp_path / "summary.csv").read_text(encoding="utf-8")


def test_a_shot_whose_process_is_killed_is_tried_twice_more(
    shots: list[BatchShot], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    StandInJob.results |= {"a": [WorkerEndedError(-9), WorkerEndedError(-9), RESULT], "b": [WorkerEndedError(-9)] * 3}
    found = run_batch(shots, tmp_path / "results", OPTIONS)
    assert states(found) == {"a": ShotState.DONE, "b": ShotState.FAILED, "c": ShotState.DONE}
    assert sorted(StandInJob.started) == ["a", "a", "a", "b", "b", "b", "c"]
    assert "ended by signal 9" in capsys.readouterr().err


@pytest.mark.parametrize(("option", "value"), [("--solver", "magic"), ("--jobs", "0")])
def test_a_wrong_option_is_refused_before_any_shot(
    shots: list[BatchShot], tmp_path: Path, capsys: pytest.CaptureFixture[str], option: str, value: str
) -> None:
    out = tmp_path / "results"
    given = ["batch", str(shots[0].file), "--out", str(out), "--no-blender", option, value]
    assert main(given) == batch_command.BAD_INPUT
    assert f"error: {option}: " in capsys.readouterr().err
    assert not out.exists()


def test_an_interrupt_ends_the_processes_and_what_is_done_stays_done(
    shots: list[BatchShot], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    del StandInJob.results["b"], StandInJob.results["c"]
    naps = iter([None, None])

    def nap(_seconds: float) -> None:
        if next(naps, "over") == "over":
            raise KeyboardInterrupt

    monkeypatch.setattr(batch_command.time, "sleep", nap)
    files = [str(shot.file) for shot in shots]
    assert main(["batch", *files, "--out", str(tmp_path / "results"), "--no-blender", "--jobs", "3"]) == 130
    assert StandInJob.ended == ["b", "c"]
    assert states(outcomes(tmp_path / "results")) == {"a": ShotState.DONE}
    assert "1 of 3 shots are done" in capsys.readouterr().err


def test_the_table_shows_all_shots_of_the_folder_whichever_command_tracked_them(
    shots: list[BatchShot], tmp_path: Path
) -> None:
    out = tmp_path / "results"
    StandInJob.results["b"] = [FootageError("it <breaks> off")] * 2
    for shot in shots:
        main(["batch", str(shot.file), "--out", str(out), "--no-blender"])
    (out / "a").mkdir()
    cv2.imwrite(str(out / "a" / "overlay.png"), np.full((30, 40, 3), 200, np.uint8))
    main(["batch", str(shots[1].file), "--out", str(out), "--no-blender"])
    rows = list(csv.DictReader((out / "summary.csv").open(newline="", encoding="utf-8")))
    assert [(row["shot"], row["state"]) for row in rows] == [
        ("a", ShotState.DONE),
        ("b", ShotState.REFUSED),
        ("c", ShotState.DONE),
    ]
    assert rows[0]["expected_error_mm"] == "12.0"
    assert rows[0]["warnings"] == RESULT["warnings"][0]
    page = (out / "summary.html").read_text(encoding="utf-8")
    assert page.count("<img") == 1
    assert "2 of 3 shots" in page
    assert "<breaks>" not in page


def test_shots_are_chosen_by_patterns_and_other_files_beside_them_left_out(
    shots: list[BatchShot],
    folder: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    shutil.copy(folder / "calibration.toml", folder / "shots" / "calibration.toml")
    (folder / "shots" / "broken.toml").write_text("[shot")
    found = chosen_shots([str(folder / "shots" / "*.toml"), str(shots[0].file)])
    assert [shot.name for shot in found] == ["a", "b", "broken", "c"]
    assert [shot.name for shot in found if shot.error is not None] == ["broken"]
    assert "calibration.toml is no shot file" in capsys.readouterr().err
    shutil.copy(shots[0].file, folder / "shots" / "z.toml")
    assert main(["batch", str(folder / "shots" / "*.toml"), "--out", str(folder / "results"), "--no-blender"]) == 2
    assert "'a' is the name of two shots" in capsys.readouterr().err
    assert main(["batch", str(folder / "shots"), "--out", str(folder / "results")]) == 2
    assert "is no shot file, but a folder: name its files, as with *.toml" in capsys.readouterr().err
    assert main(["batch", str(folder / "nothing*.toml"), "--out", str(folder / "results")]) == 2


def test_files_that_cannot_be_read_are_told_apart_by_their_folders(tmp_path: Path) -> None:
    """Each is a shot with bad input, and none keeps the others from being tracked because both are called shot.toml."""
    for name in ("one", "two"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "shot.toml").write_text("[shot")
    one, two = chosen_shots([str(tmp_path / "*" / "shot.toml")])
    assert one.error is not None and two.error is not None
    assert one.name.endswith("_one_shot") and two.name.endswith("_two_shot")
    [alone] = chosen_shots([str(tmp_path / "one" / "shot.toml")])
    assert alone.name == "shot"


def test_a_terminal_shows_one_line_for_every_shot_and_takes_it_away(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("sys.stderr.isatty", lambda: True)
    with BatchDisplay(3) as display:
        display.update({"a": ("solve", 0.25), "b": ("footage", 0.0)})
        display.finished(ShotOutcome("a", "a.toml", ShotState.DONE, **RESULT))
    shown = capsys.readouterr().err
    assert "0 of 3 shots" in shown
    assert "solve               25%" in shown
    assert shown.index("\x1b[3F\x1b[J") < shown.index("kfmocap: [1/3] a: done, 3 s, expected error 12 mm")


class KilledAtFirst(Job):
    """A job whose process is killed the first time."""

    kills = 1

    def __init__(self, work: Any) -> None:
        super().__init__(work)
        if KilledAtFirst.kills:
            KilledAtFirst.kills -= 1
            os.kill(self.process_id, signal.SIGKILL)


@pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="processes are killed otherwise there")
def test_results_are_whole_though_a_process_is_killed(
    folder: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setattr(batch_command, "Job", KilledAtFirst)
    out = folder / "results"
    assert main(["batch", str(folder / "shot.toml"), "--out", str(out), "--no-blender"]) == 0
    assert sorted(file.name for file in (out / "tiny").iterdir()) == ["overlay.png", "report.json", "tiny.trc"]
    assert sorted(file.name for file in out.iterdir()) == ["status", "summary.csv", "summary.html", "tiny"]
    assert "ended from outside" in capsys.readouterr().err


@pytest.mark.skipif(find_spec("bpy") is None, reason="Blender's module is not installed")
def test_a_batch_writes_the_files_of_blender(folder: Path) -> None:
    """Blender's module is loaded by the command, and by each process that tracks a shot, whatever that changes in where
    modules are found.
    """
    command = [sys.executable, "-m", "kfmocap", "batch", str(folder / "shot.toml"), "--out", str(folder / "results")]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    written = {file.suffix for file in (folder / "results" / "tiny").iterdir()}
    assert {".blend", ".bvh", ".fbx"} <= written


@pytest.mark.parametrize("text", ["[" * 5000, "5", "{}", '{"name": 5}', '{"name": "a", "warnings": [1]}'])
def test_what_came_of_a_shot_is_left_out_where_it_cannot_be_read(tmp_path: Path, text: str) -> None:
    ShotOutcome("b", "b.toml", ShotState.DONE, expected_error=1.0, seconds=2.0, warnings=("a",)).write(tmp_path)
    good = json.loads((tmp_path / "status" / "b.json").read_text())
    (tmp_path / "status" / "a.json").write_text(text)
    for field in good:
        (tmp_path / "status" / f"{field}.json").write_text(json.dumps(good | {field: [{}]}))
    assert [outcome.name for outcome in outcomes(tmp_path)] == ["b"]
    assert write_summary(tmp_path, outcomes(tmp_path))
