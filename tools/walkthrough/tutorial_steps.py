"""The steps of docs/tutorial.md, carried out as a user would: in Blender, with mouse and keyboard.

Run by `tools/tutorial.py`; the argument after `--` is the folder with the examples, the extension's zip and the
pictures.
"""

from __future__ import annotations

import sys
from pathlib import Path

import bpy
import numpy as np
from bpy_extras.view3d_utils import location_3d_to_region_2d
from mathutils import Vector

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE))

import blender_screen as screen
from blender_screen import Place, Waits, choose_file, click, click_at, click_quickly, find, photograph, press, until

WORK = Path(sys.argv[sys.argv.index("--") + 1])
PICTURES = WORK / "pictures"


def picture(name: str) -> Waits:
    """Save a screenshot under a name that the page uses."""
    yield from photograph(PICTURES / f"{name}.png")


def window() -> bpy.types.Window:
    """Blender's only window."""
    return bpy.context.window_manager.windows[0]


def scene() -> bpy.types.Scene:
    """The scene that the window shows."""
    return window().scene


def view3d() -> tuple[bpy.types.Area, bpy.types.Region]:
    """The 3D view whose sidebar is open (or the only 3D view) and its main region."""
    areas = [a for a in window().screen.areas if a.type == "VIEW_3D"]
    area = max(areas, key=lambda a: a.spaces.active.show_region_ui)
    return area, next(r for r in area.regions if r.type == "WINDOW")


def in_view(share: tuple[float, float] = (0.3, 0.5)) -> Place:
    """A place in the 3D view, as fractions of its width and height from its upper left corner."""
    _, region = view3d()
    height = window().height
    return round(region.x + share[0] * region.width), round(height - region.y - (1 - share[1]) * region.height)


def shown_at(point: np.ndarray) -> Place:
    """Where on the screen the 3D view shows a point of the world."""
    area, region = view3d()
    x, y = location_3d_to_region_2d(region, area.spaces.active.region_3d, Vector(point))
    return round(region.x + x), round(window().height - region.y - y)


def truth(example: str) -> dict[str, np.ndarray]:
    """Positions of the joints on every frame, (F, 3) each, from a file: a user would see them in the footage."""
    lines = (WORK / example / "landmarks.trc").read_text().splitlines()
    names = [name for name in lines[3].split("\t")[2:] if name]
    rows = np.array([[float(x) if x else np.nan for x in line.split("\t")] for line in lines[5:] if line.strip()])
    points = rows[:, 2 : 2 + 3 * len(names)].reshape(len(rows), len(names), 3)[..., [2, 0, 1]]
    return {name: points[:, i] for i, name in enumerate(names)}


def pass_first_start() -> Waits:
    """Leave the settings that Blender asks for when it starts for the first time; not every build does."""
    if screen.is_shown("Continue"):
        yield from click("Continue")
    yield from press("Escape", in_view())


def install() -> Waits:
    """Preferences > Get Extensions > Install from Disk."""
    yield from pass_first_start()
    yield from click("Edit", within=(0, 0, 300, 30))
    yield from click("Preferences...")
    yield from click("Get Extensions")
    beside = find("Repositories")
    yield from click_at((screen.screenshot().shape[1] - 19, beside[1]))
    yield from picture("install")
    yield from click("Install from Disk...")
    yield from choose_file(WORK / "kfmocap.zip", "Install from Disk")
    yield from until(lambda: hasattr(bpy.types.Scene, "kfmocap"))
    yield from click("Back to Previous")


def open_tab() -> Waits:
    """Press N and open the tab."""
    yield from press("n", in_view())
    yield from click("KF Mocap", sideways=True)
    yield from picture("tab")


def add_footage() -> Waits:
    """Add the three videos of the example, then its calibration."""
    yield from click("Add Footage")
    yield from screen.write(str(WORK / "walk") + "/", (640, 47))
    yield from click_at((screen.screenshot().shape[1] // 2, screen.screenshot().shape[0] - 8))
    yield from press("a", (640, 300))
    yield from picture("footage_browser")
    height, width = screen.screenshot().shape[:2]
    yield from click("Add Footage", within=(width // 2, height - 60, width, height))
    yield from until(lambda: len(scene().kfmocap.views) == 3)
    yield from click("Import Calibration")
    yield from choose_file(WORK / "walk" / "calibration.toml", "Import Calibration")
    yield from until(lambda: all(view.is_calibrated for view in scene().kfmocap.views))
    yield from picture("footage")


def add_body() -> Waits:
    """Add an average body of 1.75 m beside the performer."""
    yield from only("Body")
    yield from click("Add Body")
    yield from until(lambda: len(scene().kfmocap.performers) == 1)
    yield from picture("body")


SCROLLS = 10
"""Turns of the mouse wheel at most."""


def only(section: str) -> Waits:
    """Ctrl-click on a section's title, which opens it and closes the others; scrolls to it where it is below."""
    for _ in range(SCROLLS):
        if screen.is_shown(section, within=sidebar()):
            break
        left, _, right, bottom = sidebar()
        yield from click_at(((left + right) // 2, bottom - 40), button=5)
    yield from screen.click_with("ctrl", find(section, within=sidebar()))


def sidebar() -> screen.Box:
    """Where on the screen the sidebar of the 3D view is."""
    area, _ = view3d()
    region = next(r for r in area.regions if r.type == "UI")
    height = window().height
    return region.x, height - region.y - region.height, region.x + region.width, height - region.y


def placing() -> object:
    """The tool Place Joints while it runs."""
    tools = window().modal_operators
    return next(tool for tool in tools if tool.bl_idname == "KFMOCAP_OT_place_joints")


CLICKED = 15
"""How many of the requested joints to click: limbs, head and neck. The others keep their pose."""


def pose(frame: int, joints: dict[str, np.ndarray], photographed: str = "") -> Waits:
    """Click the joints of a frame (from 0) of the example in two cameras, then press Enter."""
    yield from click("Place Joints")
    for view in ("cam01", "cam02"):
        while scene().camera.name != view:
            yield from press("Next", in_view())
        for name in [n for n in placing()._placing.missing(view)[:CLICKED] if n in joints]:
            while placing()._asked_in(view) != name:
                yield from press("Tab", in_view())
            yield from click_quickly(shown_at(joints[name][frame]))
        if view == "cam01" and photographed:
            yield from picture(f"{photographed}_one_camera")
    if photographed:
        yield from picture(f"{photographed}_two_cameras")
    yield from press("Return")
    yield from press("Home", in_view())


def key_poses() -> Waits:
    """Set key poses on the first and the last frame, then fit the body to them."""
    joints = truth("walk")
    yield from only("Key Poses")
    yield from pose(0, joints, "joints")
    yield from click("To Frame 60")
    yield from pose(59, joints)
    yield from picture("key_poses")
    yield from only("Body")
    before = bone_lengths()
    yield from click("Fit Body")
    yield from until(lambda: idle() and bone_lengths() != before, screen.WORK_SECONDS)
    yield from picture("fitted")


def bone_lengths() -> list[float]:
    """Lengths of the performer's bones, metres."""
    return [bone.length for bone in scene().kfmocap.performers[0].armature.data.bones]


def tracked_keys() -> int:
    """Number of keys that the tracker has written."""
    action = scene().kfmocap.performers[0].armature.animation_data.action
    curves = action.layers[0].strips[0].channelbags[0].fcurves
    return sum(key.type == "GENERATED" for curve in curves for key in curve.keyframe_points)


def idle() -> bool:
    """Whether no tool is running."""
    return not window().modal_operators


SHOWN = 0.1
"""Share of the tracking that is done when its picture is taken."""


def track() -> Waits:
    """Track the frames between the key poses."""
    yield from only("Track")
    yield from click("Track All")
    yield from until(lambda: idle() or window().modal_operators[0].job.state[1] > SHOWN, screen.WORK_SECONDS)
    yield from picture("tracking")
    yield from until(lambda: idle() and tracked_keys(), screen.WORK_SECONDS)
    yield from to_frame(30)
    yield from picture("tracked")


def timeline() -> bpy.types.Region:
    """The main region of the timeline."""
    area = next(a for a in window().screen.areas if a.type == "DOPESHEET_EDITOR")
    return next(r for r in area.regions if r.type == "WINDOW")


def to_frame(frame: int) -> Waits:
    """Click on a frame in the timeline."""
    region = timeline()
    x, _ = region.view2d.view_to_region(frame, 0, clip=False)
    top = window().height - region.y - region.height
    yield from click_at((region.x + x, top + 10))


def correct() -> Waits:
    """Add a key pose where the review says that it helps most, then track the two segments beside it again."""
    joints = truth("walk")
    yield from only("Review")
    x, y = find("One more key pose would help most at", within=sidebar())
    yield from click_at((x, y + 20))
    yield from picture("review")
    yield from only("Key Poses")
    yield from pose(scene().frame_current - 1, joints)
    yield from only("Track")
    yield from click("Track Changes")
    yield 2.0
    yield from until(idle, screen.WORK_SECONDS)
    yield from picture("tracked_again")


def export() -> Waits:
    """Export the motion as BVH and FBX."""
    yield from only("Export")
    yield from picture("export")
    yield from click("Export", within=below("Root Motion"))
    (WORK / "exported").mkdir()
    yield from choose_file(f"{WORK / 'exported'}/", "Export")
    yield from until(lambda: list((WORK / "exported").glob("*.fbx")))


def real_shot() -> Waits:
    """Load the beam from its shot file, show its four cameras side by side, and track it."""
    if not (WORK / "beam" / "cam01.mp4").exists():
        return
    yield from only("Footage and Cameras")
    yield from click("Load Shot")
    yield from choose_file(WORK / "beam" / "shot.toml", "Load Shot")
    yield from until(lambda: len(scene().kfmocap.views) == 4)
    yield 1.0
    yield from only("Look Through")
    x, y = find("Next", within=sidebar())
    yield from click_at((x + 57, y))  # the icon of four views
    yield 2.0
    yield from picture("beam")
    x, y = find("Next", within=sidebar())
    yield from click_at((x + 57, y))
    yield 2.0
    yield from only("Track")
    yield from click("Track All")
    yield from until(lambda: idle() and tracked_keys(), screen.WORK_SECONDS)
    yield from to_frame(50)
    yield from only("Review")
    yield from picture("beam_tracked")


def below(label: str) -> screen.Box:
    """The part of the sidebar below a label."""
    left, _, right, bottom = sidebar()
    return left, find(label, within=sidebar())[1] + 8, right, bottom


def set_up() -> None:
    """Have Blender show what a script can find: browsers that fill the window, no splash screen, no tooltips."""
    view = bpy.context.preferences.view
    view.show_splash = view.show_tooltips = False
    view.filebrowser_display_type = "SCREEN"
    if hasattr(view, "preferences_display_type"):  # from 5.0 on
        view.preferences_display_type = "SCREEN"


def carry_out(given: Waits) -> None:
    """Carry out some steps in a Blender that is set up for it, with a picture of where they fail."""
    PICTURES.mkdir(exist_ok=True)
    set_up()
    screen.run(given, PICTURES / "failed.png")


def steps() -> Waits:
    """All steps of the tutorial in their order."""
    bpy.context.preferences.system.use_region_overlap = False
    yield 1.0
    yield from install()
    yield from open_tab()
    yield from add_footage()
    yield from add_body()
    yield from key_poses()
    yield from track()
    yield from correct()
    yield from export()
    yield from real_shot()


if __name__ == "__main__":
    carry_out(steps())
