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

import pytest
from kfmocap.__main__ import main
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
