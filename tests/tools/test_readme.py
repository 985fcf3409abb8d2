"""What the README and the pages of docs/ show works as it is written there."""

from __future__ import annotations

import dataclasses
import importlib
import re
import shlex
import shutil
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import ROOT
from kfmocap.cli import arguments
from kfmocap.core.formats import load_cameras, read_trc
from kfmocap.core.review.scoring import joint_error
from kfmocap.core.shot.settings import Settings
from kfmocap.core.tracking.prepare import load_shot
from short_walk import short_walk

README = (ROOT / "README.md").read_text(encoding="utf-8")
PAGES = [
    ROOT / "README.md",
    ROOT / "CONTRIBUTING.md",
    *sorted(ROOT.glob("docs/*.md")),
    *sorted(ROOT.glob("examples/*/README.md")),
]
COMMANDS = [
    command
    for page in PAGES
    for command in re.findall(
        r"(?:^ {4}(?:\S+/)?|`|--command )kfmocap ([a-z]+ [^`\n]+)", page.read_text(), re.MULTILINE
    )
]


def blocks(page: Path, language: str) -> list[str]:
    """Blocks of code in a language."""
    return re.findall(rf"```{language}\n(.*?)```", page.read_text(encoding="utf-8"), re.DOTALL)


@pytest.mark.parametrize("command", COMMANDS)
def test_commands_are_understood(command: str) -> None:
    parsed = arguments.parser().parse_args(shlex.split(command, comments=True))
    assert callable(importlib.import_module(f"kfmocap.cli.{parsed.command}_command").run)


def test_commands_were_found() -> None:
    [commands] = [action.choices for action in arguments.parser()._actions if action.dest == "command"]
    assert {command.split()[0] for command in COMMANDS} == set(commands)
    assert len(COMMANDS) >= 8


def test_make_targets_exist() -> None:
    made = set(re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text(), re.MULTILINE))
    named = {
        name for page in PAGES for name in re.findall(r"(?:^ {4}|`)make ([a-z-]+)", page.read_text(), re.MULTILINE)
    }
    assert named >= {"demo", "test", "extension"}
    assert named <= made


def test_pictures_are_small() -> None:
    assert all(path.stat().st_size < 400_000 for path in (ROOT / "docs").iterdir())


@pytest.mark.parametrize("page", ["README.md", "docs/shot_file.md"])
def test_the_shot_file_can_be_read(tmp_path: Path, page: str) -> None:
    shutil.copytree(ROOT / "examples" / "walk", tmp_path / "walk")
    text, *_ = blocks(ROOT / page, "toml")
    (tmp_path / "walk" / "shot.toml").write_text(text)
    shot = load_shot(tmp_path / "walk" / "shot.toml")
    assert [view.offset for view in shot.views] == [0, 3]
    assert len(shot.performers[0].key_poses.frames) == 4


def test_the_page_on_the_shot_file_has_every_setting_with_its_default() -> None:
    text = (ROOT / "docs" / "shot_file.md").read_text(encoding="utf-8")
    rows = dict(re.findall(r"^\| `(\w+)` \| `?([^|`]+)`? \|", text.split("## `[track]`")[1], re.MULTILINE))
    assert set(rows) == {field.name for field in dataclasses.fields(Settings)}
    for name, shown in rows.items():
        default = getattr(Settings(), name)
        if default is not None:
            assert tomllib.loads(f"x = {shown}")["x"] == default, name


def test_the_calibration_on_the_page_can_be_read(tmp_path: Path) -> None:
    [text] = blocks(ROOT / "docs" / "file_formats.md", "toml")
    (tmp_path / "calibration.toml").write_text(text)
    assert load_cameras(tmp_path / "calibration.toml")["cam01"].size == (640, 360)


def test_the_python_examples_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Those of the page run one after the other, in one namespace; they begin with the README's.

    The walk is shorter than the example's.
    """
    pytest.importorskip("bpy")
    from kfmocap.kfmocap_addon import registration

    (tmp_path / "examples").mkdir()
    short_walk(tmp_path / "examples" / "walk", 12, settings=["working_size = 160", "limb_search = false"])
    monkeypatch.chdir(tmp_path)
    examples = blocks(ROOT / "docs" / "python.md", "python")
    assert blocks(ROOT / "README.md", "python") == examples[:1]
    names: dict[str, Any] = {}
    with registration.registered():
        for code in examples:
            exec(compile(code, "docs/python.md", "exec"), names)
    assert {path.name for path in (tmp_path / "results").iterdir()} == {"walk.bvh", "walk.fbx", "shot.blend"}
    keys = names["shot"].performers[0].key_poses.frames.tolist()
    before, after = names["result"].motions[0], names["motion"]
    turned = before[[keys[-1]]].difference(after[[keys[-1]]])[0]
    moved = 3 + 3 * names["body"].names.index("forearm.L")
    np.testing.assert_allclose(turned[moved], np.radians(5), atol=1e-6)
    np.testing.assert_array_equal(after.rotations[: keys[-2]], before.rotations[: keys[-2]])
    truth = read_trc(tmp_path / "examples" / "walk" / "landmarks.trc")
    assert joint_error(read_trc(tmp_path / "walk.trc"), truth, keys).mean < 60


def test_the_numbers_are_those_of_the_benchmark() -> None:
    measured = (ROOT / "docs" / "bench.md").read_text(encoding="utf-8").splitlines()
    shown = [line for line in README.splitlines() if re.match(r"\| (shot|beam|walk) ", line)]
    assert len(shown) > 1
    assert set(shown) <= set(measured)
