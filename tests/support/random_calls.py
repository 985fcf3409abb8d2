"""All operators, scenes in any state for them, and calls with random arguments, for the tests of the add-on."""

from __future__ import annotations

import random
from collections.abc import Callable
from pathlib import Path
from typing import Any

import bpy
from addon_shots import shot
from kfmocap.kfmocap_addon import registration
from kfmocap.kfmocap_addon.scene_io import scene

WALK = Path(__file__).parents[2] / "examples" / "walk"
TOOLS = [cls for cls in registration.CLASSES if issubclass(cls, bpy.types.Operator)]


def tool_of(cls: type[bpy.types.Operator]) -> Any:
    return getattr(bpy.ops.kfmocap, cls.bl_idname.split(".")[1])


def armature() -> bpy.types.Object:
    return bpy.context.scene.kfmocap.performers[0].armature


def in_mode(mode: str) -> None:
    bpy.context.view_layer.objects.active = armature()
    armature().select_set(True)
    bpy.ops.object.mode_set(mode=mode)


def rename_a_bone() -> None:
    armature().data.bones["hand.L"].name = "paw"


def lose_the_footage() -> None:
    bpy.context.scene.camera.data.background_images.clear()


def turn_the_range() -> None:
    bpy.context.scene.kfmocap.last = 3
    bpy.context.scene.kfmocap.first = 7


def move_a_key() -> None:
    armature().pose.bones["hand.L"].keyframe_insert("rotation_quaternion", frame=2.5)


CAPTURE = """
[lframe]
colour = "red"
diameter = 0.06
points = [[0,0,0],[0.4,0,0],[0.9,0,0],[0,0.6,0]]
[wand]
colours = ["green", "blue"]
diameter = 0.05
length = 0.5
[[view]]
camera = "cam01"
lframe = "cam01.mp4"
wand = "cam01.mp4"
[[view]]
camera = "cam02"
lframe = "cam02.mp4"
wand = "cam02.mp4"
"""
SUITABLE = {
    "kfmocap.load_shot": "walk/shot.toml",
    "kfmocap.open_file": "walk/shot.toml",
    "kfmocap.add_footage": "cam01.mp4",
    "kfmocap.import_calibration": "calibration.toml",
    "kfmocap.import_cameras": "walk/calibration.toml",
    "kfmocap.import_keypoints": "keypoints.json",
    "kfmocap.pose_from_landmarks": "walk/landmarks.trc",
    "kfmocap.load_capture": "capture.toml",
    "kfmocap.load_bone_map": "bones.json",
    "kfmocap.save_bone_map": "bones.json",
    "kfmocap.relink_footage": "cam01.mp4",
}
"""A file that suits a tool."""
MISHAPS: list[Callable[[], object]] = [
    lambda: None,
    lambda: bpy.ops.kfmocap.track(),
    lambda: in_mode("POSE"),
    lambda: in_mode("EDIT"),
    lambda: bpy.data.objects.remove(armature()),
    lambda: bpy.data.objects.remove(bpy.context.scene.camera),
    lambda: armature().animation_data_clear(),
    lambda: armature().scale.__setitem__(0, 2.0),
    lambda: setattr(armature().pose.bones["hand.L"], "rotation_mode", "XYZ"),
    lambda: bpy.data.objects.remove(armature().children[3]),
    lambda: bpy.context.scene.frame_set(400),
    lambda: bpy.context.window.__setattr__("scene", bpy.data.scenes.new("another")),
    rename_a_bone,
    lose_the_footage,
    turn_the_range,
    move_a_key,
]


def situation(folder: Path, dice: random.Random) -> None:
    """An empty file, or a shot to which something has happened."""
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    if dice.random() < 0.9:
        performers = ("man", "woman") if dice.random() < 0.2 else ("man",)
        scene.build_scene(shot(folder, performers), scene=bpy.context.scene)
        dice.choice(MISHAPS)()


def arguments(cls: type[bpy.types.Operator], files: list[str], dice: random.Random) -> dict[str, Any]:
    """Some of a tool's properties, with any values that Blender lets through."""
    found: dict[str, Any] = {}
    for item in tool_of(cls).get_rna_type().properties:
        if item.identifier == "rna_type" or item.is_readonly or dice.random() < 0.3:
            continue
        value = _value(item, files, dice, SUITABLE.get(cls.bl_idname, ""))
        if value is not None:
            found[item.identifier] = value
    return found


def _value(item: bpy.types.Property, files: list[str], dice: random.Random, suitable: str) -> Any:
    """A value of a property; of a file's path three times in four one that suits the tool."""
    if suitable and dice.random() < 0.75:
        if item.subtype == "FILE_PATH":
            return next(file for file in files if file.endswith(suitable))
        if item.identifier == "directory":
            return str(Path(files[1]).parent)
        if item.identifier == "files":
            return [{"name": suitable}]
    if item.type == "BOOLEAN":
        return dice.random() < 0.5
    if item.type == "STRING":
        return dice.choice(files if item.subtype in ("FILE_PATH", "DIR_PATH") else ["", "man", "cam01", "first", "x"])
    if item.type == "ENUM":
        names = [choice.identifier for choice in item.enum_items]
        return dice.choice(names) if names and not item.is_enum_flag else None
    if item.type in ("INT", "FLOAT"):
        draw = dice.randint if item.type == "INT" else dice.uniform
        low, high = max(item.hard_min, -1000), min(item.hard_max, 1000)
        values = [
            dice.choice([draw(low, high), max(low, min(high, draw(-2, 6)))]) for _ in range(max(1, item.array_length))
        ]
        return values if item.array_length else values[0]
    if item.type == "COLLECTION" and item.identifier == "files":
        return [{"name": Path(dice.choice(files)).name} for _ in range(dice.randint(0, 2))]
    return None


def place(dice: random.Random) -> dict[str, Any]:
    """Where a tool is called: from a script, or over some area of the window."""
    windows = bpy.context.window_manager.windows
    if not windows or dice.random() < 0.5:
        return {}
    area = dice.choice(list(windows[0].screen.areas))
    return {"window": windows[0], "screen": windows[0].screen, "area": area, "region": dice.choice(list(area.regions))}


def call(cls: type[bpy.types.Operator], given: dict[str, Any], undo: bool = False) -> set[str] | None:
    """What a tool returns; None where it is disabled or says what is wrong. Tracebacks are raised."""
    try:
        return tool_of(cls)("EXEC_DEFAULT", undo, **given)
    except RuntimeError as error:
        if "Traceback" in str(error) or not ("poll()" in str(error) or str(error).startswith("Error: ")):
            raise AssertionError(f"{cls.bl_idname} {given}: {error}") from None
        return None
