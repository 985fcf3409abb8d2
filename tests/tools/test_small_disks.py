"""On a disk that is too small for its results a run says so and leaves what was there: never code 0 and a part."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest
from conftest import ROOT
from made_capture import made_capture
from short_walk import short_walk
from small_disks import disk, is_whole

pytestmark = pytest.mark.long
SETTINGS = ["working_size = 120", "limb_search = false", "prediction = false"]


@pytest.fixture(scope="module", autouse=True)
def needs_disks() -> None:
    try:
        with disk(1.0):
            pass
    except OSError as error:
        pytest.skip(str(error))


@pytest.fixture(scope="module")
def shots(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """Two shots that take a second each."""
    kinds = {"keyframes": (0, 2), "settings": SETTINGS, "posed": True}
    folders = {name: tmp_path_factory.mktemp(name) for name in ("one", "other")}
    return [short_walk(folder / "walk", 3, name=name, **kinds) / "shot.toml" for name, folder in folders.items()]


def ended(*arguments: str) -> str:
    """What `small_disks` says; fails where a run left what it should not."""
    command = [sys.executable, str(ROOT / "tools" / "small_disks.py"), "--fork", *arguments]
    process = subprocess.run(command, capture_output=True, text=True, check=False)
    assert process.returncode == 0, process.stdout + process.stderr
    return process.stdout


def test_tracking_writes_all_or_says_that_the_disk_is_full(shots: list[Path]) -> None:
    command = ["track", str(shots[0]), "--out", "OUT", "--views", "cam01", "--no-blender"]
    said = ended("--sizes", "0.02,0.1,0.3,0.6,3", *command)
    assert "1 runs done, 4 ended with an error" in said


@pytest.mark.blender
def test_the_files_that_blender_writes_are_whole_or_the_run_fails(shots: list[Path]) -> None:
    """Saving reports success on a full disk: between the sizes of the pictures and of everything lies the scene."""
    said = ended("--sizes", "0.1,0.2,3", "track", str(shots[0]), "--out", "OUT", "--views", "cam01")
    assert "1 runs done, 2 ended with an error" in said


def test_calibrating_writes_all_or_says_that_the_disk_is_full(tmp_path: Path) -> None:
    wand = made_capture(tmp_path, cameras=2)
    command = ["calibrate", str(wand), "--out", "OUT/cameras.toml", "--report", "OUT/report"]
    assert "1 runs done, 3 ended with an error" in ended("--sizes", "0.02,0.1,0.2,3", *command)


def test_of_a_batch_only_whole_shots_pass_for_done(shots: list[Path]) -> None:
    said = ended("--apart", "--sizes", "1.5", "batch", *map(str, shots), "--out", "OUT", "--no-blender")
    assert "0 runs done, 1 ended with an error" in said


def test_a_file_that_is_cut_off_is_noticed() -> None:
    whole = b"Kaydara FBX Binary" + bytes(1000) + b"the mark of its end"
    assert is_whole(Path("a.fbx"), whole, whole)
    assert not is_whole(Path("a.fbx"), whole[:-20], whole)
    assert not is_whole(Path("a.json"), b'{"a": 1', b'{"a": 1}\n')
    assert not is_whole(Path("a.trc"), whole[:-1], whole)
