"""Every tool, whatever the scene and however it is called: nothing breaks."""

from __future__ import annotations

import random

import pytest

bpy = pytest.importorskip("bpy")

from kfmocap.core.errors import CalibrationError, CancelledError  # noqa: E402
from random_calls import TOOLS, arguments, call, place, situation, tool_of  # noqa: E402
from ready_scenes import make_ready  # noqa: E402

pytest_plugins = ("addon_fixtures", "random_call_fixtures")

pytestmark = [pytest.mark.blender, pytest.mark.long]

CALLS, NIGHTLY_CALLS, IN_A_ROW = 2 * len(TOOLS), 2000, 40


def test_nothing_breaks_whatever_is_called(blender, quick, files, tmp_path, capfd, pytestconfig):
    dice = random.Random(6)
    finished: set[str] = set()
    deck: list[type[bpy.types.Operator]] = []
    for number in range(NIGHTLY_CALLS if pytestconfig.getoption("nightly") else CALLS):
        if number % IN_A_ROW == 0:
            quick.error = None
            situation(tmp_path, dice)
            quick.error = dice.choice([None, None, CancelledError(), CalibrationError("broken")])
        deck = deck or dice.sample(TOOLS, len(TOOLS))
        cls = deck.pop()
        given = arguments(cls, files, dice)
        if cls.bl_idname not in finished and number // len(TOOLS) % 2:  # in every other round all find what they need
            quick.error = None
            given |= make_ready(cls.bl_idname.removeprefix("kfmocap."), tmp_path)
        with bpy.context.temp_override(**place(dice)):
            tool_of(cls).poll()
            if call(cls, given) == {"FINISHED"}:
                finished.add(cls.bl_idname)
    told = capfd.readouterr()
    assert "Traceback" not in told.out + told.err
    idle = sorted({cls.bl_idname for cls in TOOLS} - finished)
    assert len(finished) >= 0.8 * len(TOOLS), f"most tools did something at least once, but not {idle}"
