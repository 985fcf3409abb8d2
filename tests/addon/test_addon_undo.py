"""A tool does all of its work or nothing; undo takes back all of it, and redo does it again."""

from __future__ import annotations

import gc
import random
from pathlib import Path

import pytest

bpy = pytest.importorskip("bpy")

from addon_shots import FRAMES, shot  # noqa: E402
from kfmocap.kfmocap_addon.scene_io import scene  # noqa: E402
from random_calls import TOOLS, arguments, call, in_mode, tool_of  # noqa: E402
from scene_state import differences, state  # noqa: E402

pytest_plugins = ("addon_fixtures", "random_call_fixtures")

pytestmark = pytest.mark.blender

SEQUENCES, NIGHTLY_SEQUENCES = 1, 500
IN_A_SEQUENCE, LENGTH = 20, 60
UNDONE = [cls for cls in TOOLS if "UNDO" in cls.bl_options]
TRIES, NIGHTLY_TRIES = 3, 10


def tracked_scene(
    folder: Path, mode: str, performers: tuple[str, ...] = ("man",), frames: int = FRAMES
) -> dict[str, object]:
    """Build a tracked shot, to which undo comes back; return its state."""
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    scene.build_scene(shot(folder, performers, frames=frames), scene=bpy.context.scene)
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
def test_a_tool_does_all_or_nothing_and_undo_and_redo_are_exact(
    blender,
    quick,
    files,
    tmp_path,
    pytestconfig,
    mode,
):
    """Every tool finds the scene that undoing the tool before it has left, which is the same to the last value."""
    before = tracked_scene(tmp_path, mode)
    wrong, worked = {}, set()
    for cls in UNDONE:
        dice = random.Random(f"{cls.bl_idname} {mode}")
        for _ in range(NIGHTLY_TRIES if pytestconfig.getoption("nightly") else TRIES):
            finished, found = left_over(cls, arguments(cls, files, dice), before)
            broken = [item for item in found if item[1]]
            if broken:
                wrong[cls.bl_idname] = broken
                before = tracked_scene(tmp_path, mode)
            if finished:
                worked.add(cls.bl_idname)
            if finished or not tool_of(cls).poll():
                break  # what is disabled is so whatever the arguments
    assert not wrong
    assert len(worked) > 0.4 * len(UNDONE), "many tools did something"


def sequence(dice: random.Random, files: list[str], start: dict) -> list:
    """Call tools one after the other, now and then undo and redo some of them; what is then different."""
    states, found = [start], []
    for _ in range(IN_A_SEQUENCE):
        cls = dice.choice(UNDONE)
        if call(cls, arguments(cls, files, dice), undo=True) == {"FINISHED"}:
            states.append(state())
        if dice.random() < 0.2:
            back = dice.randrange(len(states))
            for step, position in ((bpy.ops.ed.undo, len(states) - 1 - back), (bpy.ops.ed.redo, len(states) - 1)):
                for _ in range(back):
                    step()
                found += [(cls.bl_idname, d) for d in differences(state(), states[position])[:3]]
    for _ in states[1:]:
        bpy.ops.ed.undo()
    return found + [("all undone", d) for d in differences(state(), start)[:3]]


def test_random_sequences_of_tools_are_undone_and_redone_to_the_last_value(
    blender,
    quick,
    files,
    tmp_path,
    pytestconfig,
):
    """Two performers, 60 frames. Each sequence begins with the scene that undoing the one before it has left."""
    quick.frames = LENGTH
    gc.collect()
    gc.freeze()  # what is loaded by now stays: it need not be gone through each time that the states are collected
    start = tracked_scene(tmp_path, "OBJECT", ("man", "woman"), LENGTH)
    usual = NIGHTLY_SEQUENCES if pytestconfig.getoption("nightly") else SEQUENCES
    for number in range(pytestconfig.getoption("undo_sequences") or usual):
        wrong = sequence(random.Random(number), files, start)
        assert not wrong, f"sequence {number}"
        quick.shots.clear()  # they would be gone through by the collector again and again
