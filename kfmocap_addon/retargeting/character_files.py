"""Putting motion files on characters of .blend files, for batches: open, send, save as another file."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import bpy
import numpy as np

from ...core.errors import BodyError, OutputError, ShotError
from ...core.retargeting.retarget import check_frames
from ...core.retargeting.transfer import RetargetOptions
from ..export.whole_files import writing
from ..scene_io.scene import set_rate
from .imported_files import IMPORTERS, import_alone, last_line
from .listed_bones import read_map
from .motion_files import read_motion
from .rigs.overrides import editable
from .rigs.rig_curves import CurveOptions
from .send import SendOptions, send_to_rig
from .shown_characters import shows
from .target_armatures import find_target

if TYPE_CHECKING:
    from ...cli.services import RetargetRequest


def retarget_file(request: RetargetRequest) -> dict[str, Any]:
    """Put a motion on a character and save the file under another name; returns the report.

    The scene takes over the motion's frame rate and range: every frame of it is a frame of the scene.
    """
    if not bpy.app.background:
        raise OutputError("a batch would close the open file", todo="run it in background, or use Send to Rig")
    given = None if request.source_map is None else read_map(request.source_map)
    with quiet():
        source, of_source = read_motion(request.motion, given)
    check_frames(source)
    options = SendOptions(
        request.preset,
        None if request.bone_map is None else read_map(request.bone_map),
        of_source,
        RetargetOptions(request.root, request.feet, request.hands, request.scale),
        CurveOptions(request.layer, float(np.radians(request.angle)), request.distance / 1000),
    )
    open_file(request.character)
    armature = editable(find_target(request.armature, request.preset), bpy.context.scene)
    scene = show_scene_of(armature)
    set_rate(scene, source.fps)
    scene.frame_start = 1
    scene.frame_end = len(source)
    scene.frame_set(1)
    report = send_to_rig(scene, source, armature, 1, options)
    save_copy(request.out)
    return {"motion": str(request.motion), "character": str(request.character), **report}


def open_file(path: Path) -> None:
    """Open a .blend file, in object mode, or import a character of another program into an empty one.

    Raises
    ------
    ShotError
        Blender cannot read it.
    """
    if path.suffix.lower() in IMPORTERS:
        with quiet():
            import_alone(path)
        return
    try:
        with quiet():
            bpy.ops.wm.open_mainfile(filepath=str(path.resolve()), load_ui=False)
    except RuntimeError as error:
        raise ShotError(f"Blender cannot open it: {last_line(error)}", where=str(path)) from error
    if bpy.context.mode != "OBJECT":
        bpy.ops.object.mode_set(mode="OBJECT")


@contextmanager
def quiet() -> Iterator[None]:
    """Keep what Blender itself prints off standard output, where a batch lists the files that it wrote."""
    sys.stdout.flush()
    kept, nowhere = os.dup(1), os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, 1)
    try:
        yield
    finally:
        os.dup2(kept, 1)
        os.close(kept)
        os.close(nowhere)


def show_scene_of(armature: bpy.types.Object) -> bpy.types.Scene:
    """Show a scene that contains an armature, or an instance of it, as Blender evaluates no other.

    Raises
    ------
    BodyError
        It is in no scene.
    """
    scenes = [scene for scene in bpy.data.scenes if shows(scene, armature)]
    if not scenes:
        raise BodyError("it is in no scene", where=f"armature {armature.name}", todo="link it to a collection")
    scene = bpy.context.scene if bpy.context.scene in scenes else scenes[0]
    bpy.context.window.scene = scene
    return scene


def save_copy(path: Path) -> None:
    """Save the open file under another name, whole or not at all; paths in it stay right."""
    with writing(path) as target:
        # Blender makes relative paths relative to where it saves, which must be the folder that the file will be in.
        beside = path.resolve().with_name(f"{target.parents[1].name}{path.suffix}")
        try:
            bpy.ops.wm.save_as_mainfile(filepath=str(beside), copy=True, check_existing=False, relative_remap=True)
            os.replace(beside, target)
        finally:
            beside.unlink(missing_ok=True)
