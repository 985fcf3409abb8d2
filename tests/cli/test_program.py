"""The program itself: how it starts, shows its progress, and ends."""

from __future__ import annotations

import os
import subprocess
import sys
from importlib import metadata
from pathlib import Path

import pytest
from kfmocap.__main__ import main
from kfmocap.cli import progress_bar
from tiny_shot import assert_refused

pytest_plugins = ("tiny_shot_fixtures",)


def test_without_a_shot_file_outside_blender_one_is_asked_for(
    folder: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delitem(sys.modules, "bpy", raising=False)
    code = main(["track", "--out", str(folder / "out"), "--no-blender"])
    assert_refused(folder, capsys, code, "no shot file is named")


def test_the_progress_bar_is_drawn_on_terminals_alone(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    with progress_bar.progress_bar() as progress:
        assert progress is None
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True, raising=False)
    with progress_bar.progress_bar() as progress:
        assert progress is not None
        assert progress("solve", 0.5)
    drawn = capsys.readouterr().err
    assert "solve" in drawn
    assert "50%" in drawn


def test_the_progress_bar_is_as_long_as_the_share_of_the_work_that_is_done(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "70")
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True, raising=False)
    with progress_bar.progress_bar() as progress:
        assert progress is not None
        progress("solve", 0.25)
    assert "[" + 10 * "#" + 30 * "." + "]" in capsys.readouterr().err


def test_the_program_starts_without_blender_and_the_libraries() -> None:
    """`kfmocap --help` answers at once, and the libraries are loaded after they have been told to be quiet."""
    code = "import sys, kfmocap.__main__\nassert not {'bpy', 'numpy', 'cv2'} & set(sys.modules)"
    subprocess.run([sys.executable, "-c", code], check=True)


def test_the_program_says_its_version(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        main(["--version"])
    assert ended.value.code == 0
    assert capsys.readouterr().out.startswith(f"kfmocap {metadata.version('kfmocap')}, Python 3.")


ENDING = (
    "import atexit, kfmocap.__main__ as m\n"
    "atexit.register(print, 'taken apart')\n"
    "m.main = lambda: print('written') or 3\n"
    "m.program()"
)
"""A program whose command prints a word and has the exit code 3."""


def test_the_program_ends_at_once_with_its_exit_code() -> None:
    """To take the libraries apart takes a tenth of a second, when all is written."""
    run = subprocess.run([sys.executable, "-c", ENDING], capture_output=True, text=True)
    assert (run.returncode, run.stdout) == (3, "written\n")


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="there is no full device")
def test_a_program_whose_output_is_lost_ends_as_python_does_then() -> None:
    buffered = {name: value for name, value in os.environ.items() if name != "PYTHONUNBUFFERED"}
    with open("/dev/full", "w") as full:
        run = subprocess.run([sys.executable, "-c", ENDING], env=buffered, stdout=full, stderr=subprocess.PIPE)
    assert run.returncode == 120
