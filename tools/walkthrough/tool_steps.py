"""The animator's tools in Blender's window, with mouse and keyboard: what each does, and what it leaves alone.

Run by `tools/tutorial.py --steps tools`; the argument after `--` is the folder with the examples and the extension's
zip. Every step checks what came of it.
"""

from __future__ import annotations

import importlib
import sys
from pathlib import Path

import bpy
import numpy as np

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE))

import blender_screen as screen
import file_steps as files
import tutorial_steps as tutorial
from blender_screen import Place, Waits, click, click_at, expect, press, until
from tutorial_steps import WORK, idle, in_view, only, picture, scene, sidebar, window


def drawing() -> Waits:
    """The model over the footage: outlines at first, and bones as rings to take hold of."""
    yield from only("Look Through")
    expect(scene().kfmocap.display == "OUTLINE", "outlines are drawn at first")
    yield from click("Bones", within=sidebar())
    armature = scene().kfmocap.performers[0].armature
    expect(armature.data.show_bone_custom_shapes, "bones are drawn as rings")
    yield from picture("rings")
    with bpy.context.temp_override(window=window()):
        window().view_layer.objects.active = armature
    yield from press("ctrl+Tab", in_view((0.6, 0.8)))
    expect(armature.mode == "POSE", "Ctrl Tab goes to pose mode")
    yield from picture("rings_posing")
    yield from press("ctrl+Tab", in_view((0.6, 0.8)))
    yield from click("Outline", within=sidebar())


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


def placing() -> Waits:
    """While joints are placed everything beside the footage is the user's; only Enter keys a pose."""
    marks = tutorial.placing()._placing.marks
    yield from tutorial.to_frame(30)
    expect(not idle() and scene().frame_current == 30, "a click in the timeline shows another frame, the tool waits")
    yield from tutorial.to_frame(12)
    yield from press("ctrl+z", in_view())
    expect(len(tutorial.placing()._placing.marks) == len(marks) - 1, "Ctrl Z takes back the last mark only")
    yield from press("ctrl+shift+z", in_view())
    expect(len(tutorial.placing()._placing.marks) == len(marks), "Ctrl Shift Z brings it again")
    yield from press("n", in_view())
    yield from press("n", in_view())
    yield from click_at(in_view((0.3, 0.3)), button=4)
    yield from click_at(in_view((0.3, 0.3)), button=5)
    yield from click_at((screen.screenshot().shape[1] - 150, 400))  # the editor beside the view
    expect(not idle() and scene().frame_current == 12, "N, the wheel and clicks in other editors are not the tool's")
    yield from click_at(in_view((0.3, 0.3)), button=3)
    expect(not idle(), "a right-click asks before it throws marks away")
    yield from picture("asked")
    yield from press("Tab", in_view((0.3, 0.3)))
    yield from press("a", in_view((0.3, 0.3)))
    yield 2.0
    expect(tutorial.placing()._placing.alternatives, "A shows poses that look alike from this camera")
    yield from picture("alternatives")
    before = key_frames()
    yield from press("Return", in_view((0.3, 0.3)))
    expect(idle() and key_frames() == sorted([*before, 12]), "Enter keys the pose")
    yield from press("ctrl+z", in_view((0.3, 0.3)))
    expect(key_frames() == before, "one undo takes it back")
    yield from press("ctrl+shift+z", in_view((0.3, 0.3)))
    expect(key_frames() == sorted([*before, 12]), "a redo brings it again")


def keys() -> Waits:
    """The keys of the 3D view, the pie menu, and the preferences that show them."""
    yield from press("ctrl+alt+comma", in_view())
    expect(scene().frame_current == 1, "a key goes to the key pose before")
    camera = scene().camera
    yield from press("ctrl+alt+Next", in_view())
    expect(scene().camera != camera, "a key looks through the next view")
    yield from press("ctrl+alt+Prior", in_view())
    yield from press("ctrl+alt+m", in_view((0.4, 0.5)))
    yield from picture("pie")
    yield from click("Next Key Pose")
    expect(scene().frame_current == 12, "the pie menu goes to the next key pose")
    yield from click("Edit", within=(0, 0, 300, 30))
    yield from click("Preferences...")
    yield from click("Add-ons")
    x, y = screen.find("KF Mocap")
    yield from click_at((x - 63, y))  # the arrow that unfolds it
    expect(screen.is_shown("Keys in the 3D view"), "the preferences show the keys")
    yield from picture("preferences")
    yield from click("Back to Previous")


def tracking() -> Waits:
    """Frames fill in, can be gone through, and a click on Cancel takes everything back."""
    yield from only("Track")
    yield from click("Track All")
    yield from until(lambda: idle() or tutorial.tracked_keys(), screen.WORK_SECONDS)
    expect(not idle(), "frames fill in while it tracks")
    yield from tutorial.to_frame(20)
    expect(not idle() and scene().frame_current == 20, "other frames can be shown meanwhile")
    yield from picture("filling_in")
    height, width = screen.screenshot().shape[:2]
    yield from click("Cancel", within=(0, height - 40, width, height))
    expect(idle() and not tutorial.tracked_keys(), "Cancel in the status bar takes everything back")
    yield from click("Track All")
    yield from until(lambda: idle() and tutorial.tracked_keys(), screen.WORK_SECONDS)


def planting() -> Waits:
    """When a foot stands on the ground is set beside its bar: on frames that a dialog asks for."""
    yield from only("Review")
    yield from tutorial.to_frame(min(plants("heel.R")) + 1)
    yield from to_plants()
    yield from picture("plants")
    slot, before = scene().kfmocap.performers[0], plants("heel.R")
    frame = scene().frame_current
    expect(frame in before, "the right heel stands on this frame")
    _, y = screen.find("heel.R", within=sidebar())
    yield from click_at((sidebar()[2] - _NOT_PLANTED, y))
    yield from picture("plant_dialog")
    yield from press("Return")
    run = before - plants("heel.R")
    expect(frame in run and not slot.plant_edits[0].planted, "its plant on this frame is offered, and taken away")
    yield from picture("plant_removed")
    yield from press("ctrl+z", in_view())
    expect(plants("heel.R") == before, "one undo brings it back")
    yield from press("ctrl+shift+z", in_view())
    yield from to_plants()
    _, y = screen.find("heel.R", within=sidebar())
    yield from click_at((sidebar()[2] - _PLANTED, y))
    yield from press("Return")
    expect(plants("heel.R") == before - run | {frame}, "and the button beside it plants the frame that is shown")
    yield from picture("plant_added")


_PLANTED, _NOT_PLANTED = 76, 54
"""Pixels from the right of the sidebar to the buttons beside the bar of a point of a foot."""


def to_plants() -> Waits:
    """Scroll to the bars of the feet."""
    for _ in range(tutorial.SCROLLS):
        if screen.is_shown("ball.R", within=sidebar()):
            return
        left, _, right, bottom = sidebar()
        yield from click_at(((left + right) // 2, bottom - 40), button=5)


def plants(point: str) -> set[int]:
    """Scene frames on which a point of the performer's feet is planted."""
    found = scene().kfmocap.performers[0].plants
    return {f for plant in found if plant.name == point for f in range(plant.first, plant.last + 1)}


def sheets() -> Waits:
    """The dope sheet of another workspace shows the keys, without a bone being selected."""
    width = screen.screenshot().shape[1]
    yield from click("Animation", within=(0, 0, width, 30))
    yield 2.0
    expect(not any(s.show_only_selected for s in _dope_sheets()), "dope sheets show the keys of all bones")
    yield from picture("dope_sheet")
    yield from click("Layout", within=(0, 0, width, 30))
    yield 2.0


def timeline() -> tuple[float, float]:
    """First and last frame that the timeline shows."""
    area = next(a for a in window().screen.areas if a.type == "DOPESHEET_EDITOR")
    region = next(r for r in area.regions if r.type == "WINDOW")
    left, right = (region.view2d.region_to_view(x, 0)[0] for x in (0, region.width))
    return left, right


def _dope_sheets() -> list[bpy.types.DopeSheet]:
    spaces = [area.spaces.active for area in window().screen.areas]
    return [space.dopesheet for space in spaces if space.type == "DOPESHEET_EDITOR"]


def proposing() -> Waits:
    """Key poses proposed from keypoints, with pictures to accept or refuse."""
    if not (WORK / "beam" / "cam01.mp4").exists():
        return
    given = (WORK / "beam" / "shot_keypoints.toml").read_text()
    sparse = WORK / "beam" / "sparse.toml"
    sparse.write_text(given.replace("keyframes = [0, 33, 66, 99]", "keyframes = [0]"))
    yield from files.drop(sparse)
    yield from until(lambda: scene().name.startswith("beam"), 60)
    left, right = timeline()
    expect(left <= 1 and 100 <= right < 110, "the timeline shows the whole shot, though it has one key pose only")
    yield from only("Key Poses")
    yield from click("From Other Poses", within=sidebar())  # folds, so that what is below is shown
    yield from click("From Keypoints and Landmarks", within=sidebar())
    yield from picture("from_keypoints")
    yield from click("Pose from Keypoints")
    yield from until(lambda: idle() and proposals(), screen.WORK_SECONDS)
    proposed = proposals()
    yield from screen.settled()  # the list of key poses has grown
    yield from click("Pictures", within=sidebar())
    yield from click("Show Pictures")
    yield 1.0
    yield from until(idle, 120)
    yield from picture("proposals")
    accepted, refused = proposed[:2]
    for frame, beside in ((accepted, _ACCEPT), (refused, _REFUSE)):
        yield from to_picture(frame)
        x, y = screen.find(str(frame), within=lower_half())
        yield from click_at((x + beside, y))
    expect(accepted in key_frames(), "a click below its picture accepts a proposal")
    expect(refused not in key_frames() and refused not in proposals(), "and refuses another")
    yield from picture("accepted")


def to_picture(frame: int) -> Waits:
    """Scroll to the buttons below a key pose's picture, which are below those in the list of key poses."""
    for _ in range(tutorial.SCROLLS):
        if screen.is_shown(str(frame), within=lower_half()):
            return
        left, _, right, bottom = sidebar()
        yield from click_at(((left + right) // 2, bottom - 40), button=5)


def lower_half() -> screen.Box:
    """Where on the screen the lower half of the sidebar is."""
    left, top, right, bottom = sidebar()
    return left, (top + bottom) // 2, right, bottom


_ACCEPT, _REFUSE = 47, 68
"""Pixels from the number of a proposal's frame to the buttons beside it."""


def key_frames() -> list[int]:
    """Scene frames of the performer's own key poses."""
    return sorted(_keyed()[0])


def proposals() -> list[int]:
    """Scene frames of proposed key poses."""
    return sorted(_keyed()[1])


def _keyed() -> tuple[dict[int, set[str]], list[int]]:
    package = type(scene().kfmocap).__module__.rpartition(".properties")[0]
    curves = importlib.import_module(f"{package}.scene_io.keys.key_pose_curves")
    return curves.keyed_bones(scene().kfmocap.performers[0].armature)


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
    yield from files.install()
    yield from files.menus()
    yield from files.drops()
    yield from drawing()
    yield from toolbar()
    yield from placing()
    yield from keys()
    yield from tracking()
    yield from planting()
    yield from sheets()
    yield from files.exporting()
    yield from files.recovering()
    yield from files.relinking()
    yield from proposing()


if __name__ == "__main__":
    tutorial.carry_out(steps())
