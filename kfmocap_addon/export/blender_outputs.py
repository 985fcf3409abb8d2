"""Outputs that need Blender: BVH, FBX and a scene that opens with everything in it."""

from __future__ import annotations

import contextlib
import os
import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import bpy

from ...core.errors import OutputError
from ...core.runtime.output_files.files import replacing
from ...core.shot.shot import Shot
from ...core.tracking.footage_reading.turned_cameras import with_turns
from ..scene_io import scene as scenes
from ..scene_io import tracked_segments
from ..scene_io.cameras import view_cameras
from ..scene_io.review import review_data
from .export_options import ExportOptions
from .exporters import export_performers
from .whole_files import writing

if TYPE_CHECKING:
    from ...cli.services import OutputRequest
    from ...core.tracking.results.track_result import TrackResult

_STEPS_UP = 3  # footage further away than that is found by its absolute path


def show_shot(shot: Shot, home: Path | str, beside: Path | None = None) -> bpy.types.Scene:
    """Show a shot without motion in a new scene, for `write_blender_outputs`; that closes the open file.

    Parameters
    ----------
    shot : Shot
    home : path
        The folder that shot.blend is going to be in: footage near it is named relative to it, from now on.
    beside : Path, optional
        A folder that exists. If `home` is still to be made in the same folder, relative paths are the same from both.

    Raises
    ------
    OutputError
        In an application with a user.
    FootageError
        Blender cannot read some footage.
    """
    scene, folder, shot = _fresh_scene(), Path(home).resolve(), _with_absolute_paths(shot)
    # Blender takes relative paths from there as long as no file is open. If the folder is still to be made, paths are
    # changed afterwards, and Blender opens all footage again.
    there = folder if folder.is_dir() or beside is None else beside.resolve()
    same = there.is_dir() and (there == folder or there.parent == folder.parent)
    with contextlib.chdir(there) if same else nullcontext():
        scenes.build_scene(shot, scene=scene, stored=partial(_portable, folder=folder) if same else str)
        for item, path in _paths(folder):
            _set_path(item, path)
    _open_on_footage(scene)
    bpy.context.view_layer.update()  # for which the motion would wait later
    return scene


def write_blender_outputs(
    shot: Shot,
    result: TrackResult,
    request: OutputRequest,
    finish: Callable[[bpy.types.Scene], None] | None = None,
) -> list[Path]:
    """Write NAME.bvh, NAME.fbx (NAME_PERFORMER.* for several performers) and shot.blend; an earlier shot.blend becomes
    shot.blend1.

    If the open scene shows the shot already, its armatures get the motion, and shot.blend is a copy of the open file.
    Otherwise a new scene shows the shot; that closes the open file, so it needs a process without a user.

    Parameters
    ----------
    shot : Shot
    result : TrackResult
        Of that shot.
    request : OutputRequest
        Its folder is created if it does not exist; its hands are for the caller.
    finish : callable, optional
        Called with the scene once it has the motion, before files are written.

    Returns
    -------
    list of Path
        The files written.

    Raises
    ------
    OutputError
        If a file cannot be written, or a new scene is asked for in an application with a user.
    """
    folder, shot = Path(request.folder).resolve(), with_turns(shot, result.turns)
    if request.open_scene or request.shown:
        scene = bpy.context.scene
        scenes.write_motions(scene, result.motions, shot)
        view_cameras.show_turns(scene, shot, result.turns)
    else:
        scene = _fresh_scene()
        scenes.build_scene(shot, result.motions, scene)
        _open_on_footage(scene)
    if finish is not None:
        finish(scene)
    review_data.write_review(scene, [(shot, result, 0)])
    tracked_segments.remember_footage(scene, result)
    options = ExportOptions(leave_out_unknown=request.leave_out_unknown)
    paths = export_performers(scene, folder, options)
    home, path = Path(request.home or folder).resolve(), folder / "shot.blend"
    paths_from_home = nullcontext() if request.shown else _portable_paths(home)
    with writing(path) as target, paths_from_home:
        bpy.ops.wm.save_as_mainfile(filepath=str(target), copy=True, check_existing=False, relative_remap=False)
        _keep_earlier(home / path.name, path.with_suffix(".blend1"))
    paths.append(path)
    return paths


def _keep_earlier(scene: Path, kept: Path) -> None:
    """Keep a scene that is going to be replaced, as Blender does when it saves: an animator may have corrected it."""
    if scene.is_file():
        with replacing(kept) as target:
            shutil.copy2(scene, target)


def _with_absolute_paths(shot: Shot) -> Shot:
    """Return a shot whose files are found from any working directory."""
    views = [
        replace(view, footage=view.footage.absolute(), keypoints=view.keypoints and view.keypoints.absolute())
        for view in shot.views
    ]
    return replace(shot, views=tuple(views))


def _fresh_scene() -> bpy.types.Scene:
    if not bpy.app.background:
        raise OutputError("a batch would close the open file", todo="give the open scene, or run in background")
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    return bpy.context.scene


def _open_on_footage(scene: bpy.types.Scene) -> None:
    """Make the 3D views of the file look through the scene's camera."""
    scene.name = scene.kfmocap.shot
    for screen in bpy.data.screens:
        for area in screen.areas:
            if area.type == "VIEW_3D":
                area.spaces.active.region_3d.view_perspective = "CAMERA"


@contextmanager
def _portable_paths(folder: Path) -> Iterator[None]:
    """Set paths as a file in a folder needs them while the block saves it, and restore them afterwards."""
    new = _paths(folder)
    before = [(item, item.filepath) for item, _ in new]
    try:
        for item, path in new:
            _set_path(item, path)
        yield
    finally:
        for item, path in before:
            _set_path(item, path)


def _set_path(item: Any, path: str) -> None:
    """Set the path of a file, unless it is that already: Blender would open footage again, a tenth of a second each."""
    if item.filepath != path:
        item.filepath = path


def _paths(folder: Path) -> list[tuple[Any, str]]:
    """All that is in files of its own, with the paths that a file in that folder needs for them."""
    data = bpy.data
    kinds = (
        data.movieclips,
        data.images,
        data.sounds,
        data.fonts,
        data.volumes,
        data.cache_files,
        data.libraries,
    )
    items = [item for kind in kinds for item in kind if _is_path(item.filepath)]
    return [(item, _portable(bpy.path.abspath(item.filepath, library=item.library), folder)) for item in items]


def _is_path(path: str) -> bool:
    """Whether a path is not empty, and not the name of something built in, such as a font's `<builtin>`."""
    return bool(path) and not path.startswith("<")


def _portable(path: str, folder: Path) -> str:
    """Return a path relative to a folder if it is near, so that both can be moved together, or else an absolute
    path.
    """
    with contextlib.suppress(ValueError):  # no way leads from one drive of Windows to another
        steps = os.path.relpath(path, folder).split(os.sep)
        if steps[: _STEPS_UP + 1] != [os.pardir] * (_STEPS_UP + 1):
            return "//" + "/".join(steps)
    return path
