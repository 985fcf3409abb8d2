"""VRM animation (.vrma): glTF with the extension VRMC_vrm_animation 1.0, which any VRM character plays.

https://github.com/vrm-c/vrm-specification/tree/master/specification/VRMC_vrm_animation-1.0
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import bpy
import numpy as np

from ...core.errors import BodyError
from ...core.retargeting.bone_roles.bone_presets import PRESETS
from ...core.retargeting.bone_roles.roles import PARENTS
from ..retargeting.target_armatures import target_bones
from .glb_animation import add_turns_between, packed, unpacked

_EXTENSION = "VRMC_vrm_animation"
_REQUIRED = ("hips", "spine", "head", *(f"{s}{b}" for s in ("left", "right") for b in ("UpperArm", "UpperLeg")))
_NO_THUMB = "Intermediate"
"""Bone that the thumbs of VRM 1.0 lack: theirs are metacarpal, proximal and distal."""


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
        for vrm, name in zip(their, _spread(own.get(role, ()), len(their)), strict=False):
            found[vrm[0].lower() + vrm[1:]] = name
    missing = [name for name in _REQUIRED if name not in found]
    if missing:
        raise BodyError(
            f"VRM animation needs a bone for {', '.join(missing)}",
            where=f"armature {armature.name}",
            todo="export glTF",
        )
    return found


def _spread(names: Sequence[str], most: int) -> list[str]:
    """Return at most so many of some names, from the first to the last."""
    if len(names) <= most:
        return list(names)
    return [names[round(k)] for k in np.linspace(0, len(names) - 1, most)]


def as_vrm_animation(glb: bytes, bones: Mapping[str, str]) -> bytes:
    """Return a .glb file's content as a VRM animation: rotations of the humanoid's bones, and the way of its hips.

    Turns of bones between them are added to those of the humanoid's bones below, as nothing else is played.

    Parameters
    ----------
    bones : mapping of str to str
        Names of nodes by VRM's names of bones.
    """
    content, binary = unpacked(glb)
    nodes = {node.get("name", ""): n for n, node in enumerate(content["nodes"])}
    humans = {bone: {"node": nodes[name]} for bone, name in bones.items() if name in nodes}
    content["extensionsUsed"] = sorted({*content.get("extensionsUsed", ()), _EXTENSION})
    content.setdefault("extensions", {})[_EXTENSION] = {"specVersion": "1.0", "humanoid": {"humanBones": humans}}
    hips = humans["hips"]["node"]
    played = {(one["node"], "rotation") for one in humans.values()} | {(hips, "translation")}
    for animation in content.get("animations", ()):
        add_turns_between(content, binary, animation, {node for node, _ in played}, hips)
        channels = animation["channels"]
        animation["channels"] = [c for c in channels if (c["target"]["node"], c["target"]["path"]) in played]
    return packed(content, binary)
