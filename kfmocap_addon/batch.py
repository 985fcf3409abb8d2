"""Outputs that need Blender: BVH, FBX and a scene that opens with everything in it."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import bpy

from ..core.errors import OutputError
from ..core.shot import Shot
from . import export, registration
from . import scene as scenes

if TYPE_CHECKING:
    from ..core.tracking import TrackResult

_STEPS_UP = 3  # footage further away than that is found by its absolute path


def write_blender_outputs(
    shot: Shot, result: TrackResult, out_dir: Path | str, scene: bpy.types.Scene | None = None
) -> list[Path]:
    """Write NAME.bvh, NAME.fbx (NAME_performer.* for several performers) and shot.blend.

    Parameters
    ----------
    shot : Shot
    result : TrackResult
        Of that shot.
    out_dir : path
        Made if it is missing.
    scene : bpy.types.Scene, optional
        The scene that the shot was read from: its armatures get the motion, and shot.blend is a copy of the
        open file. By default a new scene shows the shot; that closes the open file, so it needs a process
        without a user.

    Returns
    -------
    list of Path
        The files written.

    Raises
    ------
    OutputError
        If a file cannot be written, or a new scene is asked for in an application with a user.
    """
    folder = Path(out_dir).resolve()
    with _registered():
        if scene is None:
            scene = _fresh_scene()
            scenes.build_scene(shot, result.motions, scene)
            _open_on_footage(scene)
            remap = False
            _point_to_footage(folder)
        else:
            scenes.write_motions(scene, result.motions)
            remap = True
        paths = export.export_performers(scene, folder)
        paths.append(_save(folder / "shot.blend", remap))
    return paths


@contextmanager
def _registered() -> Iterator[None]:
    """Our properties exist on scenes for the time of a job, also where no add-on was switched on."""
    if registration.is_registered():
        yield
        return
    registration.register()
    try:
        yield
    finally:
        registration.unregister()


def _fresh_scene() -> bpy.types.Scene:
    if not bpy.app.background:
        raise OutputError(
            "a batch would close the open file", todo="give the open scene, or run in background"
        )
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    return bpy.context.scene


def _open_on_footage(scene: bpy.types.Scene) -> None:
    """Let the 3D views of the file look through the scene's camera, with our tab at hand."""
    scene.name = scene.kfmocap.shot
    for screen in bpy.data.screens:
        for area in screen.areas:
            if area.type == "VIEW_3D":
                area.spaces.active.region_3d.view_perspective = "CAMERA"
                area.spaces.active.show_region_ui = True


def _point_to_footage(folder: Path) -> None:
    """Footage near the folder is named relative to it, so that both can be moved together."""
    for clip in bpy.data.movieclips:
        path = bpy.path.abspath(clip.filepath)
        with contextlib.suppress(ValueError):
            relative = os.path.relpath(path, folder)
            if relative.split(os.sep)[: _STEPS_UP + 1] != [os.pardir] * (_STEPS_UP + 1):
                clip.filepath = "//" + relative.replace(os.sep, "/")


def _save(path: Path, remap: bool) -> Path:
    """Save a copy of the open file at the path; the open file stays what it is."""
    with export.writing(path) as target:
        bpy.ops.wm.save_as_mainfile(
            filepath=str(target), copy=True, check_existing=False, relative_remap=remap
        )
    return path
