"""Runs that are ended at random moments leave all old or all new results, say which, and nothing stays behind."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest
from conftest import ROOT
from short_walk import short_walk

pytestmark = pytest.mark.skipif(not hasattr(os, "fork"), reason="runs are forked from a process that has all loaded")


def ended(*arguments: str) -> str:
    """What `kill_runs` says of ten runs for each signal; fails where one left what it should not."""
    command = [sys.executable, str(ROOT / "tools" / "kill_runs.py"), "--kills", "10", *arguments]
    process = subprocess.run(command, capture_output=True, text=True, check=False)
    assert process.returncode == 0, process.stdout + process.stderr
    return process.stdout


def test_tracking_leaves_all_or_nothing(tmp_path: Path) -> None:
    shot = short_walk(tmp_path / "walk", 7, settings=["working_size = 120"]) / "shot.toml"
    said = ended("track", str(shot), "--out", "OUT", "--no-blender", "--views", "cam01")
    for code in (-9, 143, 130):
        assert f"exit code {code} and old results" in said


def test_a_batch_leaves_all_or_nothing_of_every_shot(tmp_path: Path) -> None:
    """Limbs are not looked for: it is the batch that is ended, whose whole time each run is measured against."""
    settings = ["working_size = 120", "limb_search = false", "prediction = false"]
    shots = [short_walk(tmp_path / name, 7, name=name, settings=settings) / "shot.toml" for name in ("one", "other")]
    ended("--apart", "batch", *map(str, shots), "--out", "OUT", "--no-blender")
