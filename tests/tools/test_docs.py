"""Everything that the documentation names exists: modules, functions, files, pages and their sections."""

from __future__ import annotations

import ast
import importlib
import re
from pathlib import Path

import pytest
from conftest import ROOT
from kfmocap.cli.arguments import parser
from test_layers import LAYERS

PAGES = [ROOT / "README.md", *sorted(ROOT.glob("docs/*.md")), *sorted(ROOT.glob("examples/*/README.md"))]
page_by_page = pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))

LINK = re.compile(r"\]\(([^)\s]+)\)")
FILE = re.compile(r"`((?:core|cli|kfmocap_addon|benchmarks|tools|tests|docs|examples)/[\w./-]*)`")
BARE_FILE = re.compile(r"`(\w+\.py)`")
NAME = re.compile(r"\b((?:kfmocap\.)?(?:core|cli|kfmocap_addon|benchmarks)(?:\.\w+)+)\b")
PACKAGES = ("core", "cli", "kfmocap_addon", "benchmarks", "tools")


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
