"""Runs that are ended at random moments leave all old or all new results, say which, and nothing stays behind."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

import kill_runs
import pytest
from conftest import ROOT
from kill_runs import Ended
from made_capture import made_capture
from short_walk import short_walk

pytestmark = [
    pytest.mark.skipif(not hasattr(os, "fork"), reason="runs are forked from a process that has all loaded"),
    pytest.mark.long,
]
SETTINGS = ["working_size = 120", "limb_search = false", "prediction = false"]
"""It is the command that is ended: tracking itself may be short."""


@pytest.fixture(scope="module")
def signals(pytestconfig: pytest.Config) -> str:
    """How many runs each signal ends, at random moments."""
    return "SIGKILL=20,SIGTERM=10,SIGINT=10" if pytestconfig.getoption("nightly") else "SIGKILL=3,SIGTERM=2,SIGINT=2"


def killed(signals: str, *arguments: str, interrupts: signal.Handlers = signal.SIG_DFL) -> str:
    """What `kill_runs` says of runs that signals end; fails where one left what it should not. The tool is started with
    SIGINT handled in a given way.
    """
    tool = str(ROOT / "tools" / "kill_runs.py")
    process = subprocess.run(
        [sys.executable, tool, "--fork", "--signals", signals, *arguments],
        env=os.environ | {"OPENBLAS_NUM_THREADS": "1"},  # twice as fast where each process has one core at most
        capture_output=True,
        text=True,
        check=False,
        preexec_fn=lambda: signal.signal(signal.SIGINT, interrupts),
    )
    assert process.returncode == 0, process.stdout + process.stderr
    return process.stdout


def test_tracking_leaves_all_or_nothing(tmp_path: Path, signals: str) -> None:
    shot = short_walk(tmp_path / "walk", 4, keyframes=(0, 2, 3), settings=SETTINGS, posed=True) / "shot.toml"
    said = killed(signals, "track", str(shot), "--out", "OUT", "--no-blender", "--views", "cam01")
    for code in (-9, 143, 130):
        assert f"exit code {code} and old results" in said


def test_calibrating_leaves_all_or_nothing_though_the_tool_runs_in_the_background(tmp_path: Path, signals: str) -> None:
    """A shell has its background programs ignore SIGINT: that must not pass on to the runs."""
    wand = made_capture(tmp_path, cameras=2)
    command = ["calibrate", str(wand), "--out", "OUT/cameras.toml", "--report", "OUT/report"]
    said = killed(signals, *command, interrupts=signal.SIG_IGN)
    for code in (-9, 143, 130):
        assert f"exit code {code} and old results" in said


def test_a_batch_leaves_all_or_nothing_of_every_shot(tmp_path: Path, signals: str) -> None:
    kinds = {"keyframes": (0, 2), "views": 1, "settings": SETTINGS, "posed": True}
    shots = [short_walk(tmp_path / name, 3, name=name, **kinds) / "shot.toml" for name in ("one", "other")]
    killed(signals, "--apart", "batch", *map(str, shots), "--out", "OUT", "--no-blender")


OUTLIVED = """
import ctypes, threading, time
threading.Thread(target=time.sleep, args=(60,)).start()
print(flush=True)
ctypes.CDLL(None).pthread_exit(None)
"""
"""A program whose first thread ends before another."""


@pytest.mark.skipif(sys.platform != "linux", reason="processes are counted in /proc")
def test_a_process_counts_until_its_last_thread_has_ended(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(kill_runs, "PATIENCE", 0.5)
    with subprocess.Popen([sys.executable, "-c", OUTLIVED], stdout=subprocess.PIPE, start_new_session=True) as process:
        assert process.stdout is not None
        process.stdout.readline()
        there = kill_runs.left(process.pid)
        process.kill()
    assert (there, kill_runs.left(process.pid)) == (1, 0)


def test_a_command_that_signals_do_not_end_is_a_failure(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def done(_: object, out: Path, *__: object) -> Ended:
        (out / "result").write_text("new")
        return Ended(0, -1, "", 0.0)

    monkeypatch.setattr(kill_runs, "run", done)
    assert kill_runs.main(["--kills", "2", "--signals", "SIGINT", "track"]) == 1
    assert "only 0 of 40 runs were ended by SIGINT" in capsys.readouterr().err


def test_no_time_is_spent_on_a_run_that_has_ended(tmp_path: Path) -> None:
    """The moment may lie long after its end where the machine was slower when a run was timed."""
    ended = kill_runs.run(["track", str(tmp_path / "none.toml"), "--out", "OUT"], tmp_path / "out", signal.SIGTERM, 600)
    assert ended.code == 1 and ended.seconds < 300
