"""Every tool, whatever the scene and however it is called: nothing breaks."""

from __future__ import annotations

import random

import pytest

bpy = pytest.importorskip("bpy")

from addon_shots import blender, tracker  # noqa: E402, F401
from kfmocap.core.errors import CalibrationError, CancelledError  # noqa: E402
from random_calls import TOOLS, arguments, call, files, place, quick, situation, tool_of  # noqa: E402, F401

pytestmark = pytest.mark.blender

CALLS, NIGHTLY_CALLS, IN_A_ROW = 300, 2000, 40


def test_nothing_breaks_whatever_is_called(blender, quick, files, tmp_path, capfd, pytestconfig):  # noqa: F811
    dice = random.Random(6)
    called: dict[str, int] = {}
    deck: list[type[bpy.types.Operator]] = []
    for number in range(NIGHTLY_CALLS if pytestconfig.getoption("nightly") else CALLS):
        if number % IN_A_ROW == 0:
            quick.error = None
            situation(tmp_path, dice)
            quick.error = dice.choice([None, None, CancelledError(), CalibrationError("broken")])
        deck = deck or dice.sample(TOOLS, len(TOOLS))
        cls = deck.pop()
        with bpy.context.temp_override(**place(dice)):
            tool_of(cls).poll()
            finished = call(cls, arguments(cls, files, dice)) == {"FINISHED"}
        called[cls.bl_idname] = called.get(cls.bl_idname, 0) + finished
    told = capfd.readouterr()
    assert "Traceback" not in told.out + told.err
    assert sum(n > 0 for n in called.values()) > 0.5 * len(TOOLS), "many tools did something at least once"
