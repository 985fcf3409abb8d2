"""The tool that docs/architecture.md shows works as it stands there."""

from __future__ import annotations

import re
import sys
from types import ModuleType

import pytest

bpy = pytest.importorskip("bpy")

from addon_shots import shot  # noqa: E402
from conftest import ROOT  # noqa: E402
from kfmocap.kfmocap_addon.scene_io import scene  # noqa: E402

pytest_plugins = ("addon_fixtures",)

pytestmark = pytest.mark.blender

NAME = "kfmocap.kfmocap_addon.operators.performers.say_height"


@pytest.fixture
def tool(blender, monkeypatch):
    page = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
    [source] = [code for code in re.findall(r"```python\n(.*?)```", page, re.DOTALL) if "class SayHeight" in code]
    module = ModuleType(NAME)
    module.__package__ = NAME.rpartition(".")[0]
    monkeypatch.setitem(sys.modules, NAME, module)
    exec(source, module.__dict__)
    for cls in module.CLASSES:
        bpy.utils.register_class(cls)
    yield bpy.ops.kfmocap.say_height
    for cls in module.CLASSES:
        bpy.utils.unregister_class(cls)


def test_the_tool_reports_where_there_is_a_performer(tool, tmp_path, capfd):
    assert not tool.poll()
    scene.build_scene(shot(tmp_path), scene=bpy.context.scene)
    assert tool() == {"FINISHED"}
    assert re.search(r"Info: .* is 1\.\d\d m tall", capfd.readouterr().out)
