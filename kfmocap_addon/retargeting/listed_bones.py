"""Bone maps as a list that the animator can edit, and from files."""

from __future__ import annotations

from pathlib import Path

import bpy

from ...core.errors import BodyError
from ...core.formats.bone_map_files import read_bone_map
from ...core.retargeting.bone_roles.bone_presets import PRESETS
from ...core.retargeting.bone_roles.roles import BoneMap


def list_bones(settings: bpy.types.PropertyGroup, bones: BoneMap) -> None:
    """Show a bone map in the list."""
    settings.bones.clear()
    for role, place, name in bones.items():
        row = settings.bones.add()
        row.name, row.bone, row.chain = role, name, place
    settings.preset = bones.preset if bones.preset in PRESETS else "auto"


def listed_map(settings: bpy.types.PropertyGroup) -> BoneMap | None:
    """Return the bone map of the list, None where it is empty; rows without a bone are left out."""
    rows = [row for row in settings.bones if row.bone]
    if not rows:
        return None
    bones: dict[str, tuple[str, ...]] = {}
    for row in sorted(rows, key=lambda row: row.chain):
        bones[row.name] = (*bones.get(row.name, ()), row.bone)
    preset = "" if settings.preset == "auto" else settings.preset
    return BoneMap(bones, preset, "file")


def read_map(path: Path) -> BoneMap:
    """Read a bone map from a file.

    Raises
    ------
    BodyError
        It is not a bone map, or names an unknown role.
    """
    preset, bones = read_bone_map(path)
    if preset and preset not in PRESETS:
        raise BodyError(f"there is no preset '{preset}'", where=str(path), todo=f"choose {', '.join(PRESETS)}")
    try:
        return BoneMap(bones, preset, "file")
    except BodyError as error:
        raise BodyError(error.what, where=str(path), todo=error.todo) from error
