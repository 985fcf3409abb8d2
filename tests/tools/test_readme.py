"""What the README shows exists and works as it stands there."""

from __future__ import annotations

import importlib
import re
import shlex
import shutil
from pathlib import Path

import pytest
from conftest import ROOT
from kfmocap.cli import arguments
from kfmocap.core.formats import read_trc
from kfmocap.core.review.scoring import joint_error
from kfmocap.core.tracking.prepare import load_shot

README = (ROOT / "README.md").read_text(encoding="utf-8")
PAGES = [ROOT / "README.md", *sorted(ROOT.glob("examples/*/README.md"))]
COMMANDS = [
    command
    for page in PAGES
    for command in re.findall(r"(?:^ {4}|`|--command )kfmocap ([^`\n]+)", page.read_text(), re.MULTILINE)
]


def block(language: str) -> str:
    """The only block of code in a language."""
    [code] = re.findall(rf"```{language}\n(.*?)```", README, re.DOTALL)
    return code


@pytest.mark.parametrize("command", COMMANDS)
def test_commands_are_understood(command: str) -> None:
    parsed = arguments.parser().parse_args(shlex.split(command, comments=True))
    assert callable(importlib.import_module(f"kfmocap.cli.{parsed.command}_command").run)


def test_commands_were_found() -> None:
    assert {command.split()[0] for command in COMMANDS} == {"track", "calibrate", "synchronise", "demo", "bench"}
    assert len(COMMANDS) >= 8


def test_make_targets_exist() -> None:
    made = set(re.findall(r"^([a-z]+):", (ROOT / "Makefile").read_text(), re.MULTILINE))
    named = set(re.findall(r"(?:^ {4}|`)make ([a-z]+)", README, re.MULTILINE))
    assert named >= {"demo", "test", "extension"} and named <= made


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_links_lead_somewhere(page: Path) -> None:
    for target in re.findall(r"\]\(([^)]+)\)", page.read_text(encoding="utf-8")):
        assert target.startswith("https://") or (page.parent / target).exists(), target


def test_pictures_are_small() -> None:
    assert all(path.stat().st_size < 400_000 for path in (ROOT / "docs").iterdir())


def test_the_shot_file_is_one(tmp_path: Path) -> None:
    shutil.copytree(ROOT / "examples" / "walk", tmp_path / "walk")
    (tmp_path / "walk" / "shot.toml").write_text(block("toml"))
    shot = load_shot(tmp_path / "walk" / "shot.toml")
    assert [view.offset for view in shot.views] == [0, 3]
    assert len(shot.performers[0].key_poses.frames) == 4


def test_the_python_example_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "examples").symlink_to(ROOT / "examples")
    monkeypatch.chdir(tmp_path)
    names: dict = {}
    exec(compile(block("python"), "README.md", "exec"), names)
    keys = names["shot"].performers[0].key_poses.frames.tolist()
    truth = read_trc(ROOT / "examples" / "walk" / "landmarks.trc")
    assert joint_error(read_trc(tmp_path / "walk.trc"), truth, keys).mean < 60


def test_the_numbers_are_those_of_the_benchmark() -> None:
    measured = (ROOT / "docs" / "bench.md").read_text(encoding="utf-8").splitlines()
    shown = [line for line in README.splitlines() if re.match(r"\| (shot|beam|walk) ", line)]
    assert len(shown) > 1 and set(shown) <= set(measured)
