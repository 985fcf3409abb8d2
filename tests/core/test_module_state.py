"""No module keeps anything from one call to the next: neither caches nor variables that functions change."""

from __future__ import annotations

import ast
from pathlib import Path

from conftest import ROOT, nodes, parsed

SOURCES = [path for room in ("core", "cli", "kfmocap_addon") for path in sorted((ROOT / room).rglob("*.py"))]
CHANGING = {
    "add",
    "append",
    "appendleft",
    "clear",
    "discard",
    "extend",
    "insert",
    "pop",
    "popitem",
    "remove",
    "setdefault",
    "update",
}
"""Methods by which lists, sets and mappings are changed."""


def place(path: Path, node: ast.AST) -> str:
    return f"{path.relative_to(ROOT).as_posix()}:{node.lineno}"


def names_of(tree: ast.Module) -> set[str]:
    """Return the names that a module assigns at its top level."""
    found = set()
    for node in tree.body:
        targets = node.targets if isinstance(node, ast.Assign) else [node.target] if hasattr(node, "target") else []
        found |= {name.id for target in targets for name in ast.walk(target) if isinstance(name, ast.Name)}
    return found


def changed_in(function: ast.AST) -> list[tuple[ast.AST, str]]:
    """Return the nodes of a function that may change a variable in place, with the variable's name."""
    found = []
    for node in ast.walk(function):
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute) and node.func.attr in CHANGING:
            found.append((node, node.func.value))
        targets = node.targets if isinstance(node, (ast.Assign, ast.Delete)) else ()
        targets = (node.target,) if isinstance(node, ast.AugAssign) else targets
        found += [(node, target.value) for target in targets if isinstance(target, (ast.Subscript, ast.Attribute))]
    return [(node, owner.id) for node, owner in found if isinstance(owner, ast.Name)]


def local_names(function: ast.FunctionDef) -> set[str]:
    stored = {n.id for n in ast.walk(function) if isinstance(n, ast.Name) and isinstance(n.ctx, ast.Store)}
    return stored | {n.arg for n in ast.walk(function) if isinstance(n, ast.arg)}


def test_functions_change_no_variable_of_their_module() -> None:
    changed = []
    for path in SOURCES:
        body = parsed(path).body
        within = [node for kind in body if isinstance(kind, ast.ClassDef) for node in kind.body]
        own = names_of(parsed(path))
        for function in (node for node in [*body, *within] if isinstance(node, ast.FunctionDef)):
            shared = own - local_names(function)
            changed += [place(path, node) for node, name in changed_in(function) if name in shared]
    assert changed == []


def test_no_function_rebinds_a_variable_of_its_module() -> None:
    rebound = [place(path, node) for path in SOURCES for node in nodes(path) if isinstance(node, ast.Global)]
    assert rebound == []


def test_no_function_caches_its_values_unseen() -> None:
    """What is remembered has an owner that forgets it again: a worker's memory, or the add-on's session."""
    cached = [
        place(path, node)
        for path in SOURCES
        for node in nodes(path)
        if isinstance(node, ast.FunctionDef)
        if any(name in {"cache", "lru_cache"} for one in node.decorator_list for name in names_in(one))
    ]
    assert cached == []


def names_in(expression: ast.expr) -> list[str]:
    return [getattr(node, "id", getattr(node, "attr", "")) for node in ast.walk(expression)]
