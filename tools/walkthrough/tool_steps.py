"""The animator's tools in Blender's window, with mouse and keyboard: what each does, and what it leaves alone.

Run by `tools/tutorial.py --steps tool`; the argument after `--` is the folder with the examples and the extension's
zip. Every step checks what came of it.
"""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import bpy
import numpy as np

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE))

import blender_screen as screen  # noqa: E402
import tutorial_steps as tutorial  # noqa: E402
from blender_screen import Place, Waits, click, click_at, press, until  # noqa: E402
from tutorial_steps import PICTURES, WORK, idle, in_view, picture, scene, window  # noqa: E402


def expect(held: object, claim: str) -> None:
    """See that something is so.

    Raises
    ------
    AssertionError
        It is not.
    """
    if not held:
        raise AssertionError(claim)
    print("seen:", claim, flush=True)


def install() -> Waits:
    """Install the extension and open its tab."""
    bpy.ops.extensions.package_install_files(
        filepath=str(WORK / "kfmocap.zip"), repo="user_default", enable_on_install=True
    )
    yield 1.0
    yield from click("Continue")
    yield from press("Escape", in_view())
    yield from press("n", in_view())
    yield from click("KF Mocap", sideways=True)


def drop(*paths: Path) -> Waits:
    """Drop files onto the 3D view, as from a file manager."""
    x, y = in_view()
    yield from screen.hover((x, y))
    command = [sys.executable, str(HERE / "drop_files.py"), str(x), str(y), *map(str, paths)]
    source = subprocess.Popen(command)
    yield from until(lambda: source.poll() is not None, 60)
    expect(source.returncode == 0, f"the window takes {', '.join(path.name for path in paths)}")
    yield from screen.settled()


def drops() -> Waits:
    """Videos, a calibration and a shot file, dropped in turn. Blender has a use for videos too, and asks."""
    yield from drop(*sorted((WORK / "walk").glob("*.mp4")))
    yield from picture("drop_menu")
    x, y = in_view()
    yield from click("Add Footage", within=(x - 200, y - 100, x + 200, y + 100))
    expect([view.name for view in scene().kfmocap.views] == ["cam01", "cam02", "cam03"], "dropped videos are views")
    yield from picture("dropped_videos")
    yield from drop(WORK / "walk" / "calibration.toml")
    expect(all(view.is_calibrated for view in scene().kfmocap.views), "a dropped calibration gives them cameras")
    yield from drop(WORK / "walk" / "shot.toml")
    yield from until(lambda: len(scene().kfmocap.performers) == 1)
    expect(tutorial.tracked_keys() == 0, "a dropped shot is a scene of its own")
    yield from picture("dropped_shot")


def toolbar() -> Waits:
    """The tool in the toolbar: a click on the footage begins Place Joints and is its first mark."""
    joints = tutorial.truth("walk")
    yield from tutorial.to_frame(12)
    yield from click_at(tool_button())
    expect(active_tool() == "kfmocap.place_joints_tool", "the toolbar has Place Joints")
    yield from picture("toolbar")
    yield from screen.click_quickly(tutorial.shown_at(joints["LShoulder"][11]))
    expect(not idle(), "a click on the footage begins it")
    expect([name for _, name in tutorial.placing()._placing.marks] == ["LShoulder"], "and marks the first joint")
    yield from screen.click_quickly(tutorial.shown_at(joints["LElbow"][11]))
    expect(len(tutorial.placing()._placing.marks) == 2, "the next click marks the next joint")
    yield from picture("toolbar_marks")


def active_tool() -> str:
    """The tool of the 3D view's toolbar that a click uses."""
    tool = window().workspace.tools.from_space_view3d_mode(bpy.context.mode)
    return tool.idname if tool is not None else ""


def tool_button() -> Place:
    """The last tool in the toolbar."""
    area, _ = tutorial.view3d()
    region = next(r for r in area.regions if r.type == "TOOLS")
    top = window().height - region.y - region.height
    picture = screen.screenshot()[top : top + region.height, region.x + 14 : region.x + 40].max(axis=2)
    rows = np.flatnonzero((picture > 150).any(axis=1))
    return region.x + 28, int(top + rows[-1] - 10)


def steps() -> Waits:
    """All steps, one after the other."""
    preferences = bpy.context.preferences
    preferences.view.show_splash = False
    preferences.view.filebrowser_display_type = preferences.view.preferences_display_type = "SCREEN"
    preferences.view.show_tooltips = False
    yield 1.0
    yield from install()
    yield from drops()
    yield from toolbar()


if __name__ == "__main__":
    PICTURES.mkdir(exist_ok=True)
    screen.run(steps(), PICTURES / "failed.png")
