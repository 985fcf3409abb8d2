"""Bone maps as JSON files: which bones of a rig play which roles, as names by role."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path

from ..errors import BodyError
from ..runtime.files import write_json


def read_bone_map(path: Path) -> tuple[str, dict[str, tuple[str, ...]]]:
    """Read a bone map: the name of its preset, which may be empty, and names of bones by role.

    Raises
    ------
    BodyError
        The file cannot be read or is no bone map; names the file and the field.
    """
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise BodyError(f"the bone map cannot be read: {error.strerror}", where=str(path)) from error
    except ValueError as error:
        raise BodyError("is no bone map: it is not JSON", where=str(path)) from error
    bones = content.get("bones") if isinstance(content, dict) else None
    if not isinstance(bones, dict):
        raise BodyError("is no bone map: it has no table 'bones'", where=str(path))
    found = {}
    for role, names in bones.items():
        listed = [names] if isinstance(names, str) else names
        if not isinstance(listed, list) or not all(isinstance(name, str) and name for name in listed):
            raise BodyError("must be the name of a bone, or a list of them", where=f"{path}, bones.{role}")
        if listed:
            found[role] = tuple(listed)
    return str(content.get("preset", "")), found


def write_bone_map(path: Path, bones: Mapping[str, Sequence[str]], preset: str = "") -> None:
    """Write a bone map.

    Raises
    ------
    OutputError
        The file cannot be written.
    """
    listed = {role: names[0] if len(names) == 1 else list(names) for role, names in bones.items()}
    write_json(path, {"preset": preset, "bones": listed})
