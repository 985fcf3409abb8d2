"""Finding missing footage, after the .blend file or the footage was moved."""

from __future__ import annotations

from pathlib import Path

import bpy

from ....core.errors import FootageError
from ...session import SESSION


def find(scene: bpy.types.Scene) -> None:
    """Note on each view of a scene whether its footage is missing."""
    for slot in scene.kfmocap.views:
        slot.missing = _is_missing(slot)


def relink(scene: bpy.types.Scene, chosen: Path) -> tuple[list[str], list[str]]:
    """Search a folder and its subfolders for missing footage.

    Of several files with the same name, the one whose path agrees with the old path on most parent folders is used.

    Parameters
    ----------
    chosen : Path
        The folder, or a file in it. If only one view misses its footage, that file is used, whatever its name.

    Returns
    -------
    found, missing : list of str
        Names of the views whose footage was found, and of those whose footage is still missing.

    Raises
    ------
    FootageError
        There is no such folder, or none of the footage is in it.
    """
    from . import footage_background

    folder = chosen if chosen.is_dir() else chosen.parent
    if not folder.is_dir():
        raise FootageError("there is no such folder", where=str(folder))
    find(scene)
    lost = [slot for slot in scene.kfmocap.views if slot.missing]
    files = [path for path in folder.rglob("*") if path.is_file()]
    found = []
    for slot in lost:
        clip = footage_background.clip_behind(slot.camera)
        was = Path(bpy.path.abspath(clip.filepath, library=clip.library))
        named = [path for path in files if path.name == was.name]
        if not named and len(lost) == 1 and chosen.is_file():
            named = [chosen]
        if named:
            nearest = max(named, key=lambda path: _alike(path, was)).resolve()
            clip.filepath = footage_background.as_blender_stores(str(nearest))
            found.append(slot.name)
    if lost and not found:
        names = ", ".join(Path(footage_background.clip_behind(slot.camera).filepath).name for slot in lost)
        raise FootageError(f"none of the missing footage is here: {names}", where=str(folder), todo="choose another")
    find(scene)
    return found, [slot.name for slot in scene.kfmocap.views if slot.missing]


def _is_missing(slot: bpy.types.PropertyGroup) -> bool:
    """Whether a view has footage whose file, or first image, is not there."""
    from . import footage_background

    clip = footage_background.clip_behind(slot.camera) if slot.camera is not None else None
    try:
        return clip is not None and not Path(bpy.path.abspath(clip.filepath, library=clip.library)).is_file()
    except OSError:
        return True


def _alike(path: Path, other: Path) -> int:
    """On how many last parts two paths agree."""
    pairs = zip(reversed(path.parts), reversed(other.parts), strict=False)
    return next((i for i, (a, b) in enumerate(pairs) if a != b), min(len(path.parts), len(other.parts)))


@bpy.app.handlers.persistent
def _opened(*_arguments: object) -> None:
    for scene in bpy.data.scenes:
        find(scene)


def register() -> None:
    """Look for the footage of every file that is opened."""
    bpy.app.handlers.load_post.append(_opened)
    SESSION.on_end(bpy.app.handlers.load_post.remove, _opened)
