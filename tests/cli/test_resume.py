"""A run that is killed, and taken up with --resume, ends with the files of a run in one go."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest
from kfmocap.__main__ import main
from kfmocap.cli import tracked_files
from kfmocap.core.errors import OutputError
from kfmocap.core.tracking.results.journal import JOURNAL_SUFFIX
from short_walk import short_walk

pytestmark = pytest.mark.skipif(os.name == "nt", reason="processes are killed by signals")
LIMIT = 120.0
SETTINGS = ["working_size = 120", "limb_search = false", "prediction = false"]


def arguments(folder: Path, out: str) -> list[str]:
    return ["track", str(folder / "walk" / "shot.toml"), "--out", str(folder / out), "--no-blender", "--views", "cam01"]


def killed(folder: Path) -> int:
    """Start a run and kill it once it has finished a segment."""
    process = subprocess.Popen([sys.executable, "-m", "kfmocap", *arguments(folder, "out")])
    until = time.monotonic() + LIMIT
    while not list(folder.glob(f"out{JOURNAL_SUFFIX}/*.segment")) and time.monotonic() < until:
        time.sleep(0.01)
    process.kill()
    return process.wait()


def results(folder: Path) -> dict[str, object]:
    """The files, without the times of the run."""
    found: dict[str, object] = {file.name: file.read_bytes() for file in folder.iterdir()}
    report = json.loads(found["report.json"])
    return found | {"report.json": {k: v for k, v in report.items() if "second" not in k}}


def test_a_killed_run_is_taken_up(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    short_walk(tmp_path / "walk", 7, keyframes=(0, 2, 4, 6), settings=SETTINGS, posed=True)
    assert main(arguments(tmp_path, "whole")) == 0
    assert killed(tmp_path) == -signal.SIGKILL
    assert not (tmp_path / "out").exists()
    assert main([*arguments(tmp_path, "out"), "--resume"]) == 0
    assert re.search(r" (1 finished segment was|\d+ finished segments were) taken from a run", capsys.readouterr().err)
    assert results(tmp_path / "out") == results(tmp_path / "whole")
    assert sorted(entry.name for entry in tmp_path.iterdir()) == ["out", "walk", "whole"]


def test_a_run_that_fails_says_how_many_finished_segments_are_kept(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    track = tracked_files.track

    def full(*args: Any, **kwargs: Any) -> None:
        track(*args, **kwargs)
        raise OutputError("the disk is full")

    monkeypatch.setattr(tracked_files, "track", full)
    short_walk(tmp_path / "walk", 5, keyframes=(0, 2, 4), settings=SETTINGS, posed=True)
    assert main(arguments(tmp_path, "out")) == 1
    said = capsys.readouterr().err.splitlines()[-2:]
    assert said == [
        "kfmocap: error: the disk is full",
        "kfmocap: 2 finished segments are kept; --resume goes on from there",
    ]
