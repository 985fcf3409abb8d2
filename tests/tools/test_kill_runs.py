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


@pytest.fixture(scope="module")
def shots(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """Two short shots."""
    found = []
    for name in ("one", "other"):
        shot = short_walk(tmp_path_factory.mktemp(name) / "walk", 7) / "shot.toml"
        text = shot.read_text().replace('name = "walk"', f'name = "{name}"', 1)
        shot.write_text(f"{text}\n[track]\nworking_size = 120\n")
        found.append(shot)
    return found


def ended(*arguments: str) -> str:
    """What `kill_runs` says of ten runs for each signal; fails where one left what it should not."""
    command = [sys.executable, str(ROOT / "tools" / "kill_runs.py"), "--kills", "10", *arguments]
    process = subprocess.run(command, capture_output=True, text=True, check=False)
    assert process.returncode == 0, process.stdout + process.stderr
    return process.stdout


def test_tracking_leaves_all_or_nothing(shots: list[Path]) -> None:
    said = ended("track", str(shots[0]), "--out", "OUT", "--no-blender", "--views", "cam01")
    for code in (-9, 143, 130):
        assert f"exit code {code} and old results" in said


def test_a_batch_leaves_all_or_nothing_of_every_shot(shots: list[Path]) -> None:
    """Limbs are not looked for: it is the batch that is ended, whose whole time each run is measured against."""
    for shot in shots:
        shot.write_text(f"{shot.read_text()}limb_search = false\nprediction = false\n")
    ended("--apart", "batch", *map(str, shots), "--out", "OUT", "--no-blender")
