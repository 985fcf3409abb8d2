"""VRM animation (.vrma): glTF with the extension VRMC_vrm_animation 1.0, which any VRM character plays.

https://github.com/vrm-c/vrm-specification/tree/master/specification/VRMC_vrm_animation-1.0
"""

from __future__ import annotations

import json
import struct
from collections.abc import Mapping
from typing import Any

import bpy

from ...core.errors import BodyError
from ...core.retargeting.bone_presets import PRESETS
from ...core.retargeting.roles import PARENTS
from ..retargeting.target_armatures import target_bones

_EXTENSION = "VRMC_vrm_animation"
_REQUIRED = ("hips", "spine", "head", *(f"{s}{b}" for s in ("left", "right") for b in ("UpperArm", "UpperLeg")))
_NO_THUMB = "Intermediate"
"""Bone that the thumbs of VRM 1.0 lack: theirs are metacarpal, proximal and distal."""
_MAGIC, _JSON = 0x46546C67, 0x4E4F534A


def humanoid_bones(armature: bpy.types.Object) -> dict[str, str]:
    """Return the names of an armature's bones by VRM's names of humanoid bones.

    Raises
    ------
    BodyError
        It is not human, or lacks a bone that VRM requires.
    """
    own, theirs = target_bones(armature).bones, PRESETS["unity"].bones
    found = {}
    for role in PARENTS:
        their = [name for name in theirs.get(role, ()) if name.rpartition("Thumb")[2] != _NO_THUMB]
        for vrm, name in zip(their, own.get(role, ()), strict=False):
            found[vrm[0].lower() + vrm[1:]] = name
    missing = [name for name in _REQUIRED if name not in found]
    if missing:
        raise BodyError(
            f"VRM animation needs a bone for {', '.join(missing)}",
            where=f"armature {armature.name}",
            todo="export glTF",
        )
    return found


def as_vrm_animation(glb: bytes, bones: Mapping[str, str]) -> bytes:
    """Return a .glb file's content as a VRM animation: rotations of the humanoid's bones, and the way of its hips.

    Parameters
    ----------
    bones : mapping of str to str
        Names of nodes by VRM's names of bones.
    """
    (size,) = struct.unpack_from("<I", glb, 12)
    content: dict[str, Any] = json.loads(glb[20 : 20 + size])
    nodes = {node.get("name", ""): n for n, node in enumerate(content["nodes"])}
    humans = {bone: {"node": nodes[name]} for bone, name in bones.items() if name in nodes}
    content["extensionsUsed"] = sorted({*content.get("extensionsUsed", ()), _EXTENSION})
    content.setdefault("extensions", {})[_EXTENSION] = {"specVersion": "1.0", "humanoid": {"humanBones": humans}}
    played = {(one["node"], "rotation") for one in humans.values()} | {(humans["hips"]["node"], "translation")}
    for animation in content.get("animations", ()):
        channels = animation["channels"]
        animation["channels"] = [c for c in channels if (c["target"]["node"], c["target"]["path"]) in played]
    text = json.dumps(content, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 4)
    rest = glb[20 + size :]
    return (
        struct.pack("<III", _MAGIC, 2, 20 + len(text) + len(rest)) + struct.pack("<II", len(text), _JSON) + text + rest
    )
