"""The tutorial and the tools, in the application with mouse and keyboard."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from conftest import ROOT

NEEDED = ("xvfb-run", "xdotool", "import")
in_a_window = pytest.mark.skipif(
    not all(map(shutil.which, NEEDED)), reason=f"needs {', '.join(NEEDED)} beside the Blender application"
)


@pytest.mark.application
@in_a_window
def test_the_tutorial_can_be_done_as_it_is_written(extension_zip: Path, tmp_path: Path) -> None:
    """From installing the zip to the exported motion; each step waits for what it should bring."""
    command = [sys.executable, ROOT / "tools" / "tutorial.py", "--zip", extension_zip]
    run = subprocess.run(
        [*command, "--work", tmp_path / "work", "--out", tmp_path / "out"], capture_output=True, text=True, check=False
    )
    assert run.returncode == 0, run.stdout + run.stderr
    shown = {picture.stem for picture in (tmp_path / "out").glob("*.jpg")}
    page = (ROOT / "docs" / "tutorial.md").read_text(encoding="utf-8")
    named = {line.split("tutorial/")[1].split(".jpg")[0] for line in page.splitlines() if line.startswith("![")}
    assert shown >= {name for name in named if not name.startswith("beam")}


@pytest.mark.application
@in_a_window
def test_the_tools_do_what_they_say_with_mouse_and_keyboard(extension_zip: Path, tmp_path: Path) -> None:
    """Each step checks what came of it: files dropped onto the 3D view, the tool in the toolbar."""
    command = [sys.executable, ROOT / "tools" / "tutorial.py", "--zip", extension_zip, "--steps", "tools"]
    run = subprocess.run([*command, "--work", tmp_path / "work"], capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stdout + run.stderr


@pytest.mark.application
@in_a_window
def test_a_tracked_shot_moves_a_rigify_character_with_few_clicks(extension_zip: Path, tmp_path: Path) -> None:
    """Sent, undone and redone in one step, its bones listed, followed live and no longer."""
    command = [sys.executable, ROOT / "tools" / "tutorial.py", "--zip", extension_zip, "--steps", "rigs"]
    run = subprocess.run(
        [*command, "--work", tmp_path / "work", "--out", tmp_path / "out"], capture_output=True, text=True, check=False
    )
    assert run.returncode == 0, run.stdout + run.stderr
    shown = {picture.name for picture in (tmp_path / "out").glob("*.jpg")}
    page = (ROOT / "docs" / "retargeting.md").read_text(encoding="utf-8")
    assert shown >= {line.split("retargeting/")[1].rstrip(")") for line in page.splitlines() if line.startswith("![")}


@pytest.mark.application
@in_a_window
@pytest.mark.parametrize("example", ["walk", "beam"])
def test_a_shot_is_done_in_one_go_with_twelve_clicks(extension_zip: Path, tmp_path: Path, example: str) -> None:
    """Tracked, reviewed, corrected and exported; clicks on joints are not counted."""
    if not (ROOT / "examples" / example / "cam01.mp4").exists():
        pytest.skip("its footage is not downloaded: run make demo")
    command = [sys.executable, ROOT / "tools" / "tutorial.py", "--zip", extension_zip, "--steps", example]
    run = subprocess.run([*command, "--work", tmp_path / "work"], capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stdout + run.stderr


@pytest.mark.parametrize("name", ["tutorial", "retargeting"])
def test_the_pages_pictures_are_there(name: str) -> None:
    page = (ROOT / "docs" / f"{name}.md").read_text(encoding="utf-8")
    named = [line.split("](")[1].rstrip(")") for line in page.splitlines() if line.startswith("![")]
    assert named and all((ROOT / "docs" / name).is_file() for name in named)
