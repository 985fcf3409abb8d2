"""Destinations of an export: names of the files, and the default folder."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import bpy

from ...core.shot.shot_spec import result_names
from ..scene_io.cameras import footage_background
from .export_formats import EXPORT_FORMATS, chosen_formats

Named = tuple[str, bpy.types.Object | None]
"""Name and armature of somebody whose motion is exported; None if the armature is gone."""


def performers(scene: bpy.types.Scene) -> list[Named]:
    """Return the performers of a scene's shot."""
    return [(slot.name, slot.armature) for slot in scene.kfmocap.performers]


def chosen(scene: bpy.types.Scene) -> list[Named]:
    """Return who is exported with the panel's settings: the performers, or the character of Send to Rig."""
    character = scene.kfmocap.retarget.target
    if scene.kfmocap.export.whom == "CHARACTER" and character is not None:
        return [(character.name, character)]
    return performers(scene)


def paths(scene: bpy.types.Scene, folder: Path, name: str = "") -> list[Path]:
    """Return the files that an export with the panel's settings writes, armature by armature.

    Raises
    ------
    ShotError
        If the name cannot be a file's.
    """
    wanted = chosen_formats(scene.kfmocap.export)
    return [folder / f"{stem}.{suffix}" for stem in stems(scene, chosen(scene), name) for suffix in wanted]


def stems(scene: bpy.types.Scene, whose: Sequence[Named], name: str = "") -> list[str]:
    """Return the names without an ending of everybody's files: NAME, or NAME_PERFORMER where there are several.

    The name is by default the shot's.

    Raises
    ------
    ShotError
        If one of them cannot be a file's.
    """
    base = name.strip()
    for suffix in EXPORT_FORMATS:  # written along, or clicked on in the file browser
        base = base.removesuffix(f".{suffix}")
    here, owners = f"scene {scene.name}", [owner for owner, _ in whose]
    return result_names(base or scene.kfmocap.shot, owners, f"{here}, performer's", f"{here}, shot's")


def proposed(scene: bpy.types.Scene) -> Path:
    """Return the path, without an ending, that was chosen last; else the shot's name, in the folder of the saved scene
    or of the footage.
    """
    chosen = scene.kfmocap.export.path
    if chosen and Path(bpy.path.abspath(chosen)).parent.is_dir():
        return Path(bpy.path.abspath(chosen))
    return _shot_folder(scene) / scene.kfmocap.shot


def _shot_folder(scene: bpy.types.Scene) -> Path:
    if bpy.data.filepath:
        return Path(bpy.data.filepath).parent
    return footage_background.footage_folder(scene) or Path.home()
