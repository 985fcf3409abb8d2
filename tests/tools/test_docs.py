"""Everything that the documentation names exists: modules, functions, files, pages and their sections."""

from __future__ import annotations

import ast
import importlib
import re
from pathlib import Path

import pytest
from conftest import ROOT
from kfmocap.cli.arguments import parser
from kfmocap.core.choices import CALIBRATION_ENDINGS, FEET, HAND_SHAPES, ROOT_MOTIONS, SOLVERS
from kfmocap.core.retargeting.bone_roles import bone_presets
from kfmocap.kfmocap_addon.export import export_formats, presets
from test_layers import LAYERS

PAGES = [
    ROOT / "README.md",
    ROOT / "CONTRIBUTING.md",
    *sorted(ROOT.glob("docs/*.md")),
    *sorted(ROOT.glob("examples/*/README.md")),
]
page_by_page = pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))

LINK = re.compile(r"\]\(([^)\s]+)\)")
FILE = re.compile(r"`((?:core|cli|kfmocap_addon|benchmarks|tools|tests|docs|examples)/[\w./-]*)`")
BARE_FILE = re.compile(r"`(\w+\.py)`")
NAME = re.compile(r"\b((?:kfmocap\.)?(?:core|cli|kfmocap_addon|benchmarks)(?:\.\w+)+)\b")
PACKAGES = ("core", "cli", "kfmocap_addon", "benchmarks", "tools", "tests")


def text_of(page: Path) -> str:
    return page.read_text(encoding="utf-8")


def anchors(page: Path) -> set[str]:
    """The anchors that GitHub makes of a page's headings."""
    headings = re.findall(r"^#+ (.*)$", text_of(page), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


def exists(dotted: str) -> bool:
    """Whether a module, or something that it defines, exists; modules that need Blender are only parsed."""
    parts = dotted.removeprefix("kfmocap.").split(".")
    for length in range(len(parts), 0, -1):
        path = ROOT.joinpath(*parts[:length])
        source = path.with_suffix(".py") if path.with_suffix(".py").exists() else path / "__init__.py"
        if source.exists():
            return defines(source, parts[length:])
    return False


def defines(source: Path, names: list[str]) -> bool:
    """Whether a module defines or imports a name, and so on downwards (a class and its method)."""
    body: list[ast.stmt] = ast.parse(source.read_text(encoding="utf-8")).body
    for name in names:
        found = [statement for statement in body if name in names_of(statement)]
        if not found:
            return False
        body = getattr(found[0], "body", [])
    return True


def names_of(statement: ast.stmt) -> set[str]:
    """The names that a statement defines or imports."""
    if isinstance(statement, ast.Import | ast.ImportFrom):
        return {alias.asname or alias.name for alias in statement.names}
    if isinstance(statement, ast.Assign):
        return {target.id for target in statement.targets if isinstance(target, ast.Name)}
    if isinstance(statement, ast.AnnAssign) and isinstance(statement.target, ast.Name):
        return {statement.target.id}
    return {statement.name} if hasattr(statement, "name") else set()


@page_by_page
def test_links_lead_somewhere(page: Path) -> None:
    for target in LINK.findall(text_of(page)):
        if target.startswith("https://"):
            continue
        path, _, anchor = target.partition("#")
        found = page.parent / path if path else page
        assert found.exists(), target
        assert not anchor or anchor in anchors(found), target


@page_by_page
def test_files_that_are_named_exist(page: Path) -> None:
    for name in FILE.findall(text_of(page)):
        assert (ROOT / name).exists(), name
    for name in BARE_FILE.findall(text_of(page)):
        assert any(list((ROOT / package).rglob(name)) for package in PACKAGES), name


@page_by_page
def test_modules_and_functions_that_are_named_exist(page: Path) -> None:
    for name in set(NAME.findall(text_of(page))):
        assert exists(name), name


@page_by_page
def test_imports_in_examples_work(page: Path) -> None:
    for block in re.findall(r"```python\n(.*?)```", text_of(page), re.DOTALL):
        for node in ast.walk(ast.parse(block)):
            if isinstance(node, ast.ImportFrom) and node.module and not node.level:  # others: test_addon_example_tool
                module = importlib.import_module(node.module)
                assert all(hasattr(module, alias.name) for alias in node.names), node.module


def test_every_page_is_linked_from_the_readme() -> None:
    linked = {(ROOT / target.partition("#")[0]).resolve() for target in LINK.findall(text_of(ROOT / "README.md"))}
    assert set(PAGES[1:]) <= linked


def test_the_page_on_the_architecture_has_every_room() -> None:
    page = text_of(ROOT / "docs" / "architecture.md")
    shown = re.findall(r"^\| `([\w/]+)` \|", page, re.MULTILINE)
    found = [path.parent for top in ("core", "kfmocap_addon") for path in (ROOT / top).rglob("*/__init__.py")]
    packages = [path.relative_to(ROOT).as_posix() for path in found]
    assert sorted(shown) == sorted([*packages, "cli", "benchmarks", "tools", "tests"])


def test_the_page_on_the_architecture_has_the_layers_in_their_order() -> None:
    page = text_of(ROOT / "docs" / "architecture.md").split("## Layers")[1].split("## ")[0]
    shown = re.findall(r"[\w.]+", "".join(re.findall(r"^ {4}(.*)$", page, re.MULTILINE)))
    assert tuple(shown) == LAYERS


def test_the_page_on_the_command_line_has_every_command_and_option() -> None:
    page = text_of(ROOT / "docs" / "command_line.md")
    sections = dict(re.findall(r"^## `kfmocap (\w+)`\n(.*?)(?=^## |\Z)", page, re.MULTILINE | re.DOTALL))
    [commands] = [action.choices for action in parser()._actions if action.dest == "command"]
    assert set(sections) == set(commands)
    for name, command in commands.items():
        options = {option for action in command._actions for option in action.option_strings} - {"-h", "--help"}
        assert set(re.findall(r"--[\w-]+", sections[name])) >= options, name


def test_the_page_on_tools_has_every_operator_with_its_tooltip() -> None:
    shown = re.findall(r"^\| ([^|]+) \| `(\w+)` \| (.*) \|$", text_of(ROOT / "docs" / "tools.md"), re.MULTILINE)
    made = []
    for path in (ROOT / "kfmocap_addon" / "operators").rglob("*.py"):
        for node in ast.parse(path.read_text(encoding="utf-8")).body:
            if isinstance(node, ast.ClassDef):
                stated = [s for s in node.body if isinstance(s, ast.Assign)]
                values = {name: ast.unparse(s.value).strip("'") for s in stated for name in names_of(s)}
                room, _, name = values.get("bl_idname", "").partition(".")
                if room == "kfmocap" and "INTERNAL" not in values.get("bl_options", ""):
                    made.append((values["bl_label"], name, " ".join((ast.get_docstring(node) or "").split())))
    assert sorted(shown) == sorted(made)


REPORTS = (
    ("core/review/track_report.py", "command_line.md", "### report.json"),
    ("core/calibration/quality.py", "calibration.md", "## Checking the result"),
    ("kfmocap_addon/retargeting/send.py", "retargeting.md", "## What is written"),
    ("kfmocap_addon/retargeting/rigs/rig_error.py", "retargeting.md", "## What is written"),
    ("core/shot/footage_faults/footage_times.py", "command_line.md", "### report.json"),
    ("core/shot/footage_faults/footage_damage.py", "command_line.md", "### report.json"),
    ("core/shot/footage_faults/frame_pattern.py", "command_line.md", "### report.json"),
    ("core/tracking/results/late_views.py", "command_line.md", "### report.json"),
)
"""Modules that make the values of a report, and the section of the page that names them."""


@pytest.mark.parametrize(("module", "page", "heading"), REPORTS)
def test_the_pages_name_every_value_of_the_reports(module: str, page: str, heading: str) -> None:
    keys = set()
    for node in ast.walk(ast.parse((ROOT / module).read_text(encoding="utf-8"))):
        if isinstance(node, ast.Dict):
            keys |= {key.value for key in node.keys if isinstance(key, ast.Constant) and isinstance(key.value, str)}
        elif isinstance(node, ast.ClassDef) and node.name in (
            "FootageRate",
            "FootageDamage",
            "FramePattern",
            "LateView",
        ):
            keys |= {
                name for statement in node.body if isinstance(statement, ast.AnnAssign) for name in names_of(statement)
            }
    level, section = heading.split(maxsplit=1)[0], text_of(ROOT / "docs" / page).split(f"{heading}\n")[1]
    section = re.split(rf"^#{{1,{len(level)}}} ", section, maxsplit=1, flags=re.MULTILINE)[0]
    assert keys
    named = set(re.findall(r"`(\w+)`", section))
    assert {key for key in keys if key not in named and not (key.endswith("_sigma") and "_sigma" in named)} == set()


CHOICES = {
    "command_line.md": [*SOLVERS, *ROOT_MOTIONS, *FEET, *bone_presets.PRESETS, *CALIBRATION_ENDINGS],
    "retargeting.md": [*bone_presets.PRESETS, *ROOT_MOTIONS, *FEET, *HAND_SHAPES],
    "file_formats.md": [*(ending for endings in CALIBRATION_ENDINGS.values() for ending in endings)]
    + [f".{name}" for name in export_formats.EXPORT_FORMATS],
    "export.md": [*(known.label for known in (*export_formats.EXPORT_FORMATS.values(), *presets.PRESETS.values()))],
}
"""What users choose from by name, and the page that explains it."""


@pytest.mark.parametrize("page", CHOICES)
def test_the_pages_have_everything_that_can_be_chosen(page: str) -> None:
    text = text_of(ROOT / "docs" / page)
    assert [name for name in CHOICES[page] if not re.search(rf"(?<![\w-]){re.escape(name)}(?![\w-])", text)] == []


@page_by_page
def test_programs_that_are_named_exist_and_have_the_options(page: Path) -> None:
    """Those that are run by `python`; `kfmocap` itself is tested in test_readme."""
    for command in re.findall(
        r"(?:^ {4}|`)(?:\.venv/bin/)?python ((?:-m kfmocap\.|tools/)[^`\n]*)", text_of(page), re.M
    ):
        name = command.removeprefix("-m kfmocap.").split()[0].removesuffix(".py")
        source = ROOT.joinpath(*re.split(r"[./]", name))
        source = source / "__main__.py" if source.is_dir() else source.with_suffix(".py")
        assert source.is_file(), command
        own, _, _ = command.partition(" track ")  # what follows is a command of kfmocap
        known = "".join(path.read_text(encoding="utf-8") for path in (source, *source.parent.glob("render/*.py")))
        for option in re.findall(r" (--[\w-]+)", own):
            assert f'"{option}"' in known, command
