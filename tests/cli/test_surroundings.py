"""Where a command is run must not harm its results: closed or full streams, other alphabets, no working folder."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="these are surroundings of Linux")
CLOSED = "<&- >&- 2>&-"


def summed_up(
    folder: Path, streams: str = "", before: str = "", **environment: str
) -> subprocess.CompletedProcess[str]:
    """Write the table of a batch, the shortest of all commands, from a shell that has changed something before."""
    command = f'"{sys.executable}" -m kfmocap batch none.toml --summary --out "{folder}" --no-blender {streams}'
    return subprocess.run(
        ["bash", "-c", f"{before}\n{command}"],
        env=os.environ | environment,
        capture_output=True,
        text=True,
        check=False,
    )


@pytest.fixture
def out(tmp_path: Path) -> Path:
    folder = tmp_path / "wälk"
    folder.mkdir()
    return folder


@pytest.mark.parametrize("streams", [CLOSED, "2>/dev/full", "| true; exit ${PIPESTATUS[0]}"])
def test_results_are_written_though_nobody_reads_what_is_said(out: Path, streams: str) -> None:
    run = summed_up(out, streams)
    assert (run.returncode, run.stderr) == (0, "")
    assert sorted(file.name for file in out.iterdir()) == ["summary.csv", "summary.html"]


def test_a_list_of_files_that_cannot_be_written_is_an_error_that_says_what_was(out: Path) -> None:
    run = summed_up(out, ">/dev/full")
    assert run.returncode == 1
    assert "the list of files cannot be written, but the files have been: No space left" in run.stderr
    assert run.stderr.count("\n") == 1


def test_names_that_the_terminal_cannot_show_are_written_as_numbers(out: Path) -> None:
    run = summed_up(out, PYTHONIOENCODING="ascii")
    assert (run.returncode, run.stderr) == (0, "")
    assert r"w\xe4lk/summary.csv" in run.stdout


def test_names_that_the_system_cannot_write_are_refused(out: Path) -> None:
    run = summed_up(out, LC_ALL="C", PYTHONUTF8="0", PYTHONCOERCECLOCALE="0")
    assert run.returncode in (0, 2) and "Traceback" not in run.stderr


def test_a_working_folder_that_is_gone_is_an_error_where_it_is_needed(tmp_path: Path) -> None:
    gone = f'mkdir "{tmp_path}/gone"; cd "{tmp_path}/gone"; rmdir "{tmp_path}/gone"'
    run = summed_up(Path("relative"), before=gone)
    assert run.returncode == 1 and "relative: cannot be written" in run.stderr
    assert run.stderr.count("\n") == 1
    assert summed_up(tmp_path, before=gone).returncode == 0
