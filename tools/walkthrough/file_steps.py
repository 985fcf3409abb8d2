"""Files in Blender's window: the extension installed, footage and shots dropped, motion exported, lost data found."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

import bpy

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE))

import blender_screen as screen
import tutorial_steps as tutorial
from blender_screen import Waits, click, expect, press, until
from tutorial_steps import WORK, idle, in_view, only, picture, scene, sidebar, window


def install() -> Waits:
    """Install the extension and open its tab."""
    bpy.ops.extensions.package_install_files(
        filepath=str(WORK / "kfmocap.zip"), repo="user_default", enable_on_install=True
    )
    yield 1.0
    yield from tutorial.pass_first_start()
    yield from press("n", in_view())
    yield from click("KF Mocap", sideways=True)


def drop(*paths: Path) -> Waits:
    """Drop files onto the 3D view, as from a file manager."""
    x, y = in_view()
    yield from screen.hover((x, y))
    command = [sys.executable, str(HERE / "drag_source.py"), str(x), str(y), *map(str, paths)]
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


def menus() -> Waits:
    """File > Import has shots."""
    yield from click("File", within=(0, 0, 300, 30))
    yield from click("Import")
    expect(screen.is_shown("KF Mocap Shot (.toml)"), "File > Import has shots")
    yield from picture("import")
    yield from press("Escape")
    yield from press("Escape")


def exporting() -> Waits:
    """The file browser says which files it replaces, and comes back to the last choice."""
    height, width = screen.screenshot().shape[:2]
    accept = (width // 2, height - 60, width, height)
    yield from only("Export")
    yield from click("Export", within=tutorial.below("Root Motion"))
    yield from click("Export", within=accept)
    yield from until(lambda: scene().kfmocap.export.written)
    yield from picture("exported")
    yield from click("Export", within=tutorial.below("Root Motion"))
    expect(screen.is_shown("Replaces walk.bvh"), "exporting again says which files are replaced")
    yield from picture("replaces")
    yield from press("Escape", (width // 2, height // 2))


def recovering() -> Waits:
    """A body that was deleted comes back by a click."""
    armature = scene().kfmocap.performers[0].armature
    with bpy.context.temp_override(window=window()):
        for thing in scene().objects:
            thing.select_set(thing == armature)
        window().view_layer.objects.active = armature
    yield from press("x", in_view())
    yield from press("Return")
    yield from until(lambda: armature.name not in scene().objects)
    yield from only("Body")
    yield from picture("deleted")
    yield from click("Bring Back")
    expect(armature.name in scene().objects, "a deleted body comes back")


def relinking() -> Waits:
    """Footage that was moved since the scene was saved is said to be missing, and found again."""
    saved = WORK / "scene.blend"
    with bpy.context.temp_override(window=window()):
        bpy.ops.wm.save_as_mainfile(filepath=str(saved))
        shutil.move(WORK / "walk", WORK / "moved")
        bpy.ops.wm.open_mainfile(filepath=str(saved))
    yield 3.0
    expect(all(view.missing for view in scene().kfmocap.views), "moved footage is missed when the file is opened")
    yield from only("Footage and Cameras")
    yield from picture("missing")
    yield from click("Relink", within=sidebar())
    yield from screen.choose_file(f"{WORK / 'moved'}/", "Relink")
    yield from until(lambda: not any(view.missing for view in scene().kfmocap.views), 30)
    expect(idle(), "Relink finds it in the folder that is chosen")
    yield from picture("relinked")
