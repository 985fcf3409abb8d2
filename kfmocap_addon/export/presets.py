"""What other programs expect of an exported skeleton: names of bones, unit, name of the armature's node."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

_SIDES = {"L": ("_l", "Left"), "R": ("_r", "Right")}


@dataclass(frozen=True)
class Preset:
    """One program's conventions.

    Attributes
    ----------
    label, description : str
        For the animator.
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


def _with_sides(middle: Mapping[str, str], limbs: Mapping[str, str]) -> dict[str, str]:
    """Names of the bones in the middle, and of those on both sides: {side} and {Side} stand for the program's words."""
    names = dict(middle)
    for letter, (side, word) in _SIDES.items():
        names |= {f"{ours}.{letter}": theirs.format(side=side, Side=word) for ours, theirs in limbs.items()}
    return names


_UNREAL = _with_sides(
    {"pelvis": "pelvis", "spine": "spine_01", "chest": "spine_03", "neck": "neck_01", "head": "head"},
    {
        "shoulder": "clavicle{side}",
        "upper_arm": "upperarm{side}",
        "forearm": "lowerarm{side}",
        "hand": "hand{side}",
        "thigh": "thigh{side}",
        "shin": "calf{side}",
        "foot": "foot{side}",
        "toe": "ball{side}",
    },
)
_UNITY = _with_sides(
    {"pelvis": "Hips", "spine": "Spine", "chest": "Chest", "neck": "Neck", "head": "Head"},
    {
        "shoulder": "{Side}Shoulder",
        "upper_arm": "{Side}UpperArm",
        "forearm": "{Side}LowerArm",
        "hand": "{Side}Hand",
        "thigh": "{Side}UpperLeg",
        "shin": "{Side}LowerLeg",
        "foot": "{Side}Foot",
        "toe": "{Side}Toes",
    },
)
_MIXAMO = _with_sides(
    {
        "pelvis": "mixamorig:Hips",
        "spine": "mixamorig:Spine",
        "chest": "mixamorig:Spine2",
        "neck": "mixamorig:Neck",
        "head": "mixamorig:Head",
    },
    {
        "shoulder": "mixamorig:{Side}Shoulder",
        "upper_arm": "mixamorig:{Side}Arm",
        "forearm": "mixamorig:{Side}ForeArm",
        "hand": "mixamorig:{Side}Hand",
        "thigh": "mixamorig:{Side}UpLeg",
        "shin": "mixamorig:{Side}Leg",
        "foot": "mixamorig:{Side}Foot",
        "toe": "mixamorig:{Side}ToeBase",
    },
)
PRESETS = {
    "BLENDER": Preset("Blender", "The bones' own names, metres"),
    "UNREAL": Preset("Unreal", "Names of Unreal's mannequin, centimetres, armature named root", 100, _UNREAL, "root"),
    "UNITY": Preset("Unity", "Names that Unity's humanoid avatar finds by itself, centimetres", 100, _UNITY),
    "MIXAMO": Preset("Mixamo", "Mixamo's names, centimetres", 100, _MIXAMO),
}
"""By what the animator chooses; all of them Y up."""
