"""Workers and Blenders that are killed while the application tracks: the scene is fine, and no process lives on."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from conftest import ROOT
from short_walk import short_walk


@pytest.mark.application
@pytest.mark.skipif(shutil.which("xvfb-run") is None, reason="needs xvfb-run beside the Blender application")
def test_killed_workers_and_blenders_leave_the_scene_and_no_process(tmp_path: Path) -> None:
    libraries = subprocess.run(
        ["blender", "--background", "--python-expr", "import scipy, cv2, filterpy"], capture_output=True, check=False
    )
    if b"ModuleNotFoundError" in libraries.stderr + libraries.stdout:
        pytest.skip("the application's Python has not what the extension needs")
    shot = short_walk(tmp_path / "walk", 3, keyframes=(0, 2), settings=["working_size = 120"]) / "shot.toml"
    (tmp_path / "package").mkdir()
    (tmp_path / "package" / "kfmocap").symlink_to(ROOT)
    command = [sys.executable, str(ROOT / "tools" / "kill_blender.py"), "--shot", str(shot), "--work", str(tmp_path)]
    run = subprocess.run(
        [*command, "--libraries", str(tmp_path / "package")], capture_output=True, text=True, check=False
    )
    assert run.returncode == 0, run.stdout + run.stderr
    assert "2 workers were killed: 0 faults" in run.stdout and "2 Blenders were killed: 0 faults" in run.stdout
