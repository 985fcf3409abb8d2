"""Blender beside the command: started early, missing, broken, or ended."""

from __future__ import annotations

import subprocess
import sys
from contextlib import closing
from importlib.util import find_spec
from pathlib import Path

import job_functions
import pytest
from kfmocap.__main__ import _BlenderProcess, main
from kfmocap.cli import command_line, tracked_files
from kfmocap.cli.services import Services, blender_needed
from tiny_shot import assert_refused, broken

pytest_plugins = ("tiny_shot_fixtures",)


def test_without_bpy_the_error_says_how_to_get_it(
    folder: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "bpy", None)
    code = main(["track", str(folder / "shot.toml"), "--out", str(folder / "out")])
    assert_refused(folder, capsys, code, "pip install 'kfmocap[blender]'", "--no-blender")


class UnloadableBlender:
    """Blender's module, started in a process, whose libraries are missing."""

    closed = False

    def check(self) -> None:
        with blender_needed():
            raise ImportError("libX11.so.6: cannot open shared object file")

    def write_outputs(self, *_: object) -> list[Path]:
        raise AssertionError("nothing can be written")

    def close(self) -> None:
        self.closed = True


def test_a_blender_that_does_not_load_is_said_before_the_tracking(
    folder: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    blender = UnloadableBlender()
    monkeypatch.setattr(tracked_files, "track", broken(AssertionError("it was tracked")))
    arguments = ["track", str(folder / "shot.toml"), "--out", str(folder / "out")]
    code = command_line.main(arguments, Services(start_blender=lambda: blender))
    assert_refused(folder, capsys, code, "libX11.so.6", "--no-blender")
    assert blender.closed


def test_blender_is_started_before_the_libraries_are_loaded_and_once(folder: Path) -> None:
    """Both take the better part of a second, on a core each."""
    code = """
import sys
from contextlib import closing
from kfmocap.cli import command_line
from kfmocap.cli.services import Services

class Blender:
    def __init__(self): started.append("numpy" in sys.modules)
    def check(self): raise SystemExit(0 if started == [False] else f"{started}")
    def close(self): closed.append(True)

started, closed = [], []
try:
    command_line.main(["track", sys.argv[1], "--out", sys.argv[2]], Services(start_blender=Blender))
finally:
    assert closed
"""
    arguments = [str(folder / "shot.toml"), str(folder / "out")]
    subprocess.run([sys.executable, "-c", code, *arguments], check=True)


def test_a_worker_is_started_before_the_libraries_are_loaded_unless_one_thread_is_asked_for(folder: Path) -> None:
    code = """
import sys
from contextlib import closing
from kfmocap.cli import command_line
from kfmocap.core.runtime.processes.worker_memory import WorkerMemory

started, closed = [], []
WorkerMemory.start_workers = lambda memory, workers, imports: started.append((workers, imports, "numpy" in sys.modules))
WorkerMemory.close = lambda memory: closed.append(True)
command_line.os.cpu_count, command_line.can_be_copied = lambda: 2, lambda: False
assert command_line.main(["track", "none.toml", "--out", sys.argv[1], "--threads", sys.argv[2]]) == 1
if sys.argv[2] == "1":
    assert not started
else:
    [(workers, imports, late)] = started
    assert (workers, late) == (2, False) and closed
    for module in imports:
        __import__(module)
"""
    for threads in ("1", "2"):
        subprocess.run([sys.executable, "-c", code, str(folder / "out"), threads], check=True)


@pytest.mark.skipif(find_spec("bpy") is None, reason="needs Blender's module")
def test_files_with_which_blender_crashes_are_named(
    folder: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delitem(sys.modules, "bpy", raising=False)
    monkeypatch.setattr("kfmocap.__main__._loaded_blender", job_functions.silently)
    monkeypatch.setattr("kfmocap.__main__._retargeted", job_functions.crashing)
    motion, character = folder / "take.bvh", folder / "hero.blend"
    motion.touch()
    character.touch()
    code = main(["retarget", str(motion), "--to", str(character), "--out", str(folder / "moved.blend")])
    assert_refused(folder, capsys, code, "take.bvh", "hero.blend: Blender ended while it worked on them")


@pytest.mark.skipif(find_spec("bpy") is None, reason="needs Blender's module")
def test_blender_is_ended_as_soon_as_its_files_are_written(monkeypatch: pytest.MonkeyPatch) -> None:
    """It takes a tenth of a second to end, during which the other results are put in place."""
    monkeypatch.delitem(sys.modules, "bpy", raising=False)
    monkeypatch.setattr("kfmocap.__main__._loaded_blender", job_functions.silently)
    monkeypatch.setattr("kfmocap.__main__._written_outputs", job_functions.writing_nothing)
    with closing(_BlenderProcess()) as blender:
        assert blender.write_outputs(None, job_functions.Tracked(), None) == []  # type: ignore[arg-type]
        blender._process._process.wait(10)


def test_a_blender_that_is_missing_is_said_after_what_is_wrong_with_the_shot(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    def missing() -> UnloadableBlender:
        raise ImportError("No module named 'bpy'")

    arguments = ["track", str(folder / "none.toml"), "--out", str(folder / "out")]
    assert command_line.main(arguments, Services(start_blender=missing)) == 1
    assert "none.toml" in capsys.readouterr().err
