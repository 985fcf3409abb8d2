"""A tool does all of its work or nothing; undo takes back all of it, and redo does it again."""

from __future__ import annotations

import random
from pathlib import Path

import pytest

bpy = pytest.importorskip("bpy")

from addon_shots import blender, shot, tracker  # noqa: E402, F401
from kfmocap.kfmocap_addon.scene_io import scene  # noqa: E402
from random_calls import TOOLS, arguments, call, files, in_mode, quick  # noqa: E402, F401
from scene_state import differences, state  # noqa: E402

pytestmark = pytest.mark.blender

UNDONE = [cls for cls in TOOLS if "UNDO" in cls.bl_options]
TRIES = 5


def tracked_scene(folder: Path, mode: str) -> dict:
    """Build a tracked shot, to which undo comes back; return its state."""
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    scene.build_scene(shot(folder), scene=bpy.context.scene)
    bpy.context.scene.frame_set(6)
    bpy.ops.kfmocap.track()
    in_mode(mode)
    bpy.ops.ed.undo_push(message="before")
    return state()


def left_over(cls: type[bpy.types.Operator], given: dict, before: dict) -> tuple[bool, list]:
    """Call a tool on the scene; whether it finished, and what failure, undo or redo leave different."""
    if call(cls, given, undo=True) != {"FINISHED"}:
        return False, [("failed", differences(state(), before))]
    after, found = state(), []
    for step, expected in ((bpy.ops.ed.undo, before), (bpy.ops.ed.redo, after), (bpy.ops.ed.undo, before)):
        step()
        found.append((step.idname_py(), differences(state(), expected)))
    return True, found


@pytest.mark.parametrize("mode", ["OBJECT", "POSE"])
def test_a_tool_does_all_or_nothing_and_undo_and_redo_are_exact(blender, quick, files, tmp_path, mode):  # noqa: F811
    """Every tool finds the scene that undoing the tool before it has left, which is the same to the last value."""
    before = tracked_scene(tmp_path, mode)
    wrong, worked = {}, set()
    for cls in UNDONE:
        dice = random.Random(f"{cls.bl_idname} {mode}")
        for _ in range(TRIES):
            finished, found = left_over(cls, arguments(cls, files, dice), before)
            broken = [item for item in found if item[1]]
            if broken:
                wrong[cls.bl_idname] = broken
                before = tracked_scene(tmp_path, mode)
            if finished:
                worked.add(cls.bl_idname)
                break
    assert not wrong
    assert len(worked) > 0.4 * len(UNDONE), "many tools did something"
