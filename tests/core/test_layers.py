"""The order of the layers: what a package may import, and that every name of the program has one meaning."""

from __future__ import annotations

import ast
from collections import defaultdict
from functools import cache
from pathlib import Path

from conftest import ROOT, nodes, parsed

LAYERS = (
    "core.errors",
    "core.choices",
    "core.runtime",
    "core.numerics",
    "core.cameras",
    "core.body",
    "core.capture",
    "core.shot",
    "core.formats",
    "core.keypoints",
    "core.evidence",
    "core.tracking",
    "core.calibration",
    "core.posing",
    "core.fitting",
    "core.review",
    "core.retargeting",
    "cli",
    "kfmocap_addon",
    "benchmarks",
)
"""From low to high: a package imports only from those before it."""

ROOMS = ("core", "cli", "kfmocap_addon", "benchmarks")
SOURCES = [path for room in ROOMS for path in sorted((ROOT / room).rglob("*.py"))]
TOOLS = sorted((ROOT / "tools").rglob("*.py"))


@cache
def dotted(path: Path) -> str:
    """Return a module's or package's name below the project's root, such as core.body.human."""
    parts = path.relative_to(ROOT).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


MODULES = {dotted(path) for path in SOURCES}


@cache
def imports(path: Path) -> list[tuple[int, str]]:
    """Return the line and the name of every module of the project that a file imports."""
    package, found = list(path.relative_to(ROOT).parts[:-1]), []
    for node in nodes(path):
        if isinstance(node, ast.ImportFrom) and node.level:
            base = ".".join([*package[: len(package) - node.level + 1], *filter(None, [node.module])])
            for alias in node.names:
                name = f"{base}.{alias.name}"
                found.append((node.lineno, name if name in MODULES else base))
    return found


def layer(name: str) -> str:
    """Return the layer that a module is in."""
    return next((one for one in LAYERS if name == one or name.startswith(f"{one}.")), "")


@cache
def package(name: str) -> str:
    """Return the package that holds a module; a module that stands beside packages is one of its own."""
    if is_package(name) or any(is_package(f"{name.rpartition('.')[0]}.{one.name}") for one in siblings(name)):
        return name
    return name.rpartition(".")[0]


@cache
def is_package(name: str) -> bool:
    return (ROOT / name.replace(".", "/") / "__init__.py").exists()


def siblings(name: str) -> list[Path]:
    return list((ROOT / name.replace(".", "/")).parent.iterdir())


def test_every_module_is_in_a_layer() -> None:
    assert [name for name in sorted(MODULES - {"core"}) if not layer(name)] == []


def test_every_relative_import_leads_to_a_module() -> None:
    """Also one inside a function, which no other test may run."""
    astray = [
        f"{path.relative_to(ROOT)}:{node.lineno}"
        for path in (*sorted(ROOT.glob("*.py")), *SOURCES)
        for node in nodes(path)
        if isinstance(node, ast.ImportFrom) and node.level and not leads_to_a_module(path, node)
    ]
    assert astray == []


def leads_to_a_module(path: Path, node: ast.ImportFrom) -> bool:
    package = path.relative_to(ROOT).parts[:-1]
    above = len(package) - node.level + 1
    place = ROOT.joinpath(*package[: max(above, 0)], *(node.module or "").split("."))
    return above >= 0 and (place.is_dir() or place.with_suffix(".py").is_file())


def test_imports_point_downward() -> None:
    upward = [
        f"{path.relative_to(ROOT)}:{line}: {layer(dotted(path))} imports {name}"
        for path in SOURCES
        for line, name in imports(path)
        if name != "core" and LAYERS.index(layer(name)) > LAYERS.index(layer(dotted(path)))
    ]
    assert upward == []


def test_no_packages_import_each_other() -> None:
    """Not even by way of others: the packages can be put in an order in which each needs only earlier ones."""
    needs: dict[str, set[str]] = defaultdict(set)
    for path in SOURCES:
        here = package(dotted(path))
        needs[here] |= {package(name) for _, name in imports(path)} - {here}
    left = dict(needs)
    while ready := [name for name, needed in left.items() if not needed & left.keys()]:
        for name in ready:
            del left[name]
    while users := [name for name in left if not any(name in left[other] for other in left.keys() - {name})]:
        for name in users:
            del left[name]
    assert {name: sorted(needed & left.keys()) for name, needed in left.items()} == {}


def test_module_names_are_unique() -> None:
    by_name = defaultdict(list)
    for path in SOURCES + TOOLS:
        if path.name != "__init__.py":
            by_name[path.name].append(str(path.relative_to(ROOT)))
    assert [paths for paths in by_name.values() if len(paths) > 1] == []


def test_class_names_are_unique() -> None:
    """Those of classes that are used in one module alone, too."""
    by_name = defaultdict(list)
    for path in SOURCES + TOOLS:
        for node in parsed(path).body:
            if isinstance(node, ast.ClassDef):
                by_name[node.name.lstrip("_")].append(f"{path.relative_to(ROOT)}:{node.lineno}")
    assert [places for places in by_name.values() if len(places) > 1] == []
