"""Bone maps as JSON files: which bones of a rig play which roles, as names by role."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from ..errors import BodyError
from ..runtime.output_files.files import write_json
from .reading import read_bytes, reading

_MAX_NAME_LENGTH = 100  # characters of a preset's name


def read_bone_map(path: Path) -> tuple[str, dict[str, tuple[str, ...]]]:
    """Read a bone map: the name of its preset, which may be empty, and the names of bones by role.

    Raises
    ------
    BodyError
        The file cannot be read or is not a bone map; names the file and the field.
    """
    data = read_bytes(path, "the bone map", BodyError)
    with reading(path, "a bone map", BodyError):
        return _bones(json.loads(data), path)


def _bones(content: Any, path: Path) -> tuple[str, dict[str, tuple[str, ...]]]:
    bones = content.get("bones") if isinstance(content, dict) else None
    if not isinstance(bones, dict):
        raise BodyError("is no bone map: it has no table 'bones'", where=str(path))
    found = {}
    for role, names in bones.items():
        listed = [names] if isinstance(names, str) else names
        if not isinstance(listed, list) or not all(isinstance(name, str) and name for name in listed):
            raise BodyError("must be the name of a bone, or a list of them", where=f"{path}, bones.{role[:40]}")
        if listed:
            found[role] = tuple(listed)
    return str(content.get("preset", ""))[:_MAX_NAME_LENGTH], found


def write_bone_map(path: Path, bones: Mapping[str, Sequence[str]], preset: str) -> None:
    """Write a bone map.

    Raises
    ------
    OutputError
        The file cannot be written.
    """
    listed = {role: names[0] if len(names) == 1 else list(names) for role, names in bones.items()}
    write_json(path, {"preset": preset, "bones": listed})
