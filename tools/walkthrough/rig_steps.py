"""The steps of docs/retargeting.md with the mouse: a tracked walk on a Rigify character, its bones, live, and back.

Run by `tools/tutorial.py --steps rigs`; the arguments after `--` are the folder with the examples, the extension's zip
and the pictures, and the steps' name.
"""

from __future__ import annotations

import sys
from pathlib import Path

import bpy
import numpy as np

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE))

import blender_screen as screen
import file_steps as files
import tutorial_steps as tutorial
from blender_screen import Waits, choose_file, click, expect, find, until
from shot_steps import ClickCount
from tutorial_steps import WORK, carry_out, idle, only, picture, scene, sidebar

AT_MOST = 6
"""Clicks from a tracked shot to the character moving."""
ALIKE = 12.0
"""Greatest difference between bends of elbows and knees, which Rigify has bent a little at rest, degrees."""
BESIDE = 99
"""Pixels from the middle of the button *Send to Rig* to the next one."""
THICKNESS = 0.22
"""Of a limb of the character's skin, in its length."""
CORNERS = np.array([[x, y, z] for y in (0, 1) for z in (-1, 1) for x in (-1, 1)])
SIDES = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))


def tracked_walk() -> Waits:
    """The example's key poses, tracked."""
    yield from files.install()
    yield from only("Footage and Cameras")
    yield from click("Load Shot")
    yield from choose_file(WORK / "walk" / "shot.toml", "Load Shot")
    yield from until(lambda: len(scene().kfmocap.performers) == 1)
    yield 2.0
    yield from screen.settled()
    yield from only("Track")
    yield from until(lambda: screen.is_shown("Track All", within=sidebar()), 20)
    yield from click("Track All")
    yield from until(lambda: idle() and tutorial.tracked_keys(), 900)


def add_character() -> bpy.types.Object:
    """Add Rigify's human, generated, with a skin of boxes: the user's own character."""
    bpy.ops.preferences.addon_enable(module="rigify")
    bpy.ops.object.armature_human_metarig_add()
    metarig = bpy.context.object
    bpy.ops.object.mode_set(mode="OBJECT")
    bpy.ops.pose.rigify_generate()
    rig = next(o for o in scene().objects if o.type == "ARMATURE" and "rig_id" in o.data)
    bpy.data.objects.remove(metarig)
    rig.name = "Hero"
    mesh = bpy.data.meshes.new("Skin")
    skin = bpy.data.objects.new("Skin", mesh)
    bones = [bone for bone in rig.data.bones if bone.use_deform and bone.length > 0.03]
    corners, faces = [], []
    for bone in bones:
        size = THICKNESS * min(bone.length, 0.3)
        faces += [[8 * len(corners) + k for k in side] for side in SIDES]
        box = CORNERS * [size, bone.length, size]
        matrix = np.array(bone.matrix_local)
        corners.append(box @ matrix[:3, :3].T + matrix[:3, 3])
    mesh.from_pydata(np.concatenate(corners).tolist(), [], faces)
    for k, bone in enumerate(bones):
        skin.vertex_groups.new(name=bone.name).add(range(8 * k, 8 * k + 8), 1.0, "REPLACE")
    skin.modifiers.new("Armature", "ARMATURE").object = rig
    skin.parent = rig
    scene().collection.objects.link(skin)
    bpy.ops.object.select_all(action="DESELECT")
    bpy.ops.ed.undo_push(message="Add Character")
    return rig


def heads(rig: bpy.types.Object, names: tuple[str, ...]) -> np.ndarray:
    """Where the heads of bones are shown, relative to the first of them, (B, 3)."""
    points = np.array([rig.matrix_world @ rig.pose.bones[name].head for name in names])
    return points - points[0]


def walks_as_the_performer(rig: bpy.types.Object) -> bool:
    """Whether elbows and knees bend as the performer's do on frames of the walk."""
    performer = scene().kfmocap.performers[0].armature
    for frame in (10, 25, 45):
        scene().frame_set(frame)
        for upper, lower, end in (("thigh", "shin", "foot"), ("upper_arm", "forearm", "hand")):
            for side in "LR":
                bends = []
                for owner, prefix in ((rig, "DEF-"), (performer, "")):
                    a, b, c = heads(owner, tuple(f"{prefix}{name}.{side}" for name in (upper, lower, end)))
                    along, below = b - a, c - b
                    bends.append(along @ below / np.linalg.norm(along) / np.linalg.norm(below))
                if abs(np.degrees(np.arccos(bends[0])) - np.degrees(np.arccos(bends[1]))) > ALIKE:
                    return False
    return True


def send(rig: bpy.types.Object) -> Waits:
    """From the tracked shot to the character moving, counting clicks."""
    counted = ClickCount()
    yield from counted.only("Send to Rig")
    yield from picture("section")
    yield from counted.click("Send to Rig", within=tutorial.below("Character"))
    yield from until(lambda: rig.animation_data and rig.animation_data.action)
    yield 1.0
    expect(len(counted.made) <= AT_MOST, f"{len(counted.made)} clicks: {', '.join(counted.made)}")


def undo_and_redo(name: str) -> Waits:
    """Sending is one step of undo; then the character walks."""
    yield from screen.press("ctrl+z", tutorial.in_view())
    data = bpy.data.objects[name].animation_data
    expect(data is None or data.action is None, "one undo takes the motion away")
    yield from screen.press("ctrl+shift+z", tutorial.in_view())
    rig = bpy.data.objects[name]
    expect(rig.animation_data.action is not None, "one redo brings it back")
    expect(walks_as_the_performer(rig), "elbows and knees of the character bend as the performer's")
    yield from tutorial.to_frame(30)
    yield from picture("sent")


def find_bones() -> Waits:
    """The list of bones, by their roles."""
    yield from click("Find Bones", within=sidebar())
    expect(len(scene().kfmocap.retarget.bones) > 20, "bones are listed by their roles")
    yield from picture("bones")


def live_and_back(rig: bpy.types.Object) -> Waits:
    """The character follows live, then no longer, and gets back what it had."""
    held = sum(len(bone.constraints) for bone in rig.pose.bones)
    yield from click("Live", within=sidebar())
    yield from click("Send to Rig", within=tutorial.below("Character"))
    yield 1.0
    expect(sum(len(bone.constraints) for bone in rig.pose.bones) > held, "live, the character follows by constraints")
    yield from picture("live")
    x, y = find("Send to Rig", within=tutorial.below("Character"))
    yield from screen.click_at((x + BESIDE, y))  # the button with the broken link
    expect(sum(len(bone.constraints) for bone in rig.pose.bones) == held, "and stops following")


def steps() -> Waits:
    """All steps in their order."""
    bpy.context.preferences.system.use_region_overlap = False
    yield 1.0
    yield from tracked_walk()
    rig = add_character()
    name = rig.name
    yield from screen.settled()
    yield from send(rig)
    yield from undo_and_redo(name)
    yield from find_bones()
    yield from live_and_back(bpy.data.objects[name])


if __name__ == "__main__":
    carry_out(steps())
