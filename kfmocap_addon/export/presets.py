"""Presets for other programs: names of bones, unit of length, and name of the armature's node."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from ...core.retargeting.bone_roles import bone_presets


@dataclass(frozen=True)
class Preset:
    """The conventions of a program that reads the files.

    Attributes
    ----------
    label, description : str
        Shown to the animator.
    scale : float
        Units of the files per metre.
    names : mapping of str to str
        The program's name of a bone, by ours; bones that it does not know keep their names.
    node : str or None
        Name of the armature's node in FBX; None for the armature's own.
    """

    label: str
    description: str
    scale: float = 1.0
    names: Mapping[str, str] = field(default_factory=dict)
    node: str | None = None


def _names(program: str, *, chest: str) -> dict[str, str]:
    """Return a program's names of our bones; `chest` is the bone of its spine that ours is."""
    theirs = bone_presets.PRESETS[program].bones
    ours = bone_presets.PRESETS["kfmocap"].bones
    pairs = (zip(bones, theirs.get(role, ()), strict=False) for role, bones in ours.items())
    return {our: their for role in pairs for our, their in role} | {"chest": chest}


_UNREAL = _names("unreal", chest="spine_03")
_UNITY = _names("unity", chest="Chest")
_MIXAMO = _names("mixamo", chest="mixamorig:Spine2")
PRESETS = {
    "BLENDER": Preset("Blender", "The bones' own names, metres"),
    "UNREAL": Preset("Unreal", "Names of Unreal's mannequin, centimetres, armature named root", 100, _UNREAL, "root"),
    "UNITY": Preset("Unity", "Names that Unity's humanoid avatar finds by itself, centimetres", 100, _UNITY),
    "MIXAMO": Preset("Mixamo", "Mixamo's names, centimetres", 100, _MIXAMO),
}
"""The presets by their names in the menu; all are Y up."""
