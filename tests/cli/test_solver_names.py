"""The names of the solvers are listed where nothing heavy may be imported; all lists are the same."""

from __future__ import annotations

import ast

from conftest import ROOT
from kfmocap.cli.arguments import parser
from kfmocap.core.shot.shot import SOLVERS, Settings
from kfmocap.core.tracking.solvers.registry import REGISTRY


def test_every_solver_that_a_shot_can_name_is_there() -> None:
    assert set(REGISTRY) == set(SOLVERS)
    assert Settings().solver in SOLVERS


def test_the_command_line_names_every_solver() -> None:
    commands = next(action for action in parser()._actions if action.dest == "command")
    for command in ("track", "demo"):
        [shown] = [a.help for a in commands.choices[command]._actions if a.dest == "solver"]
        assert shown == " or ".join(SOLVERS)


def test_the_menu_in_blender_has_every_solver() -> None:
    source = ast.parse((ROOT / "kfmocap_addon" / "properties" / "shot_properties.py").read_text(encoding="utf-8"))
    [menu] = [
        node.annotation for node in ast.walk(source) if isinstance(node, ast.AnnAssign) and node.target.id == "solver"
    ]
    [items] = [keyword.value for keyword in menu.keywords if keyword.arg == "items"]
    assert tuple(item.elts[0].value for item in items.elts) == SOLVERS
