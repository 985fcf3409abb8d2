"""A tool does all of its work or nothing; undo takes back all of it, and redo does it again."""

from __future__ import annotations

import random

import pytest

bpy = pytest.importorskip("bpy")

from addon_shots import blender, shot, tracker  # noqa: E402, F401
from any_tool import TOOLS, arguments, call, files, in_mode, quick  # noqa: E402, F401
from kfmocap.kfmocap_addon.scene_io import scene  # noqa: E402
from scene_state import differences, state  # noqa: E402

pytestmark = pytest.mark.blender

TRIES = 5


@pytest.mark.parametrize("cls", TOOLS, ids=lambda cls: cls.bl_idname)
def test_a_tool_does_all_or_nothing_and_undo_and_redo_are_exact(blender, quick, files, tmp_path, cls):  # noqa: F811
    if "UNDO" not in cls.bl_options:
        pytest.skip("it changes nothing that is undone")
    dice = random.Random(7)
    for mode in ("OBJECT", "POSE"):
        bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
        scene.build_scene(shot(tmp_path), scene=bpy.context.scene)
        bpy.context.scene.frame_set(6)
        bpy.ops.kfmocap.track()
        in_mode(mode)
        bpy.ops.ed.undo_push(message="before")
        before = state()
        for _ in range(TRIES):
            if call(cls, arguments(cls, files, dice), undo=True) == {"FINISHED"}:
                after = state()
                bpy.ops.ed.undo()
                assert not differences(state(), before)
                bpy.ops.ed.redo()
                assert not differences(state(), after)
                break
            assert not differences(state(), before)
