"""Bone names of well-known rigs, and the settings with which Rigify's controls can be driven.

In names, {s} stands for l or r, {S} for L or R, {Side} for Left or Right, and {side} for left or right.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from .roles import CHAINS, FINGERS, PARENTS

Names = Mapping[str, str | Sequence[str]]
_WORDS = {
    "L": {"s": "l", "S": "L", "Side": "Left", "side": "left"},
    "R": {"s": "r", "S": "R", "Side": "Right", "side": "right"},
}


@dataclass(frozen=True)
class IkLimb:
    """Controls of a limb that is driven by inverse kinematics.

    Attributes
    ----------
    upper, lower, end : str
        Roles of the limb's bones.
    control, pole : str
        Names of the IK control of the limb's end, and of the pole target.
    twist : str
        Name of the control that turns what follows the lower bone about its length, which inverse kinematics does not.
    beyond : tuple of str, optional
        Role of what hangs on the limb's end, and the name of its control.
    """

    upper: str
    lower: str
    end: str
    control: str
    pole: str
    twist: str
    beyond: tuple[str, str] | None


@dataclass(frozen=True)
class BonePreset:
    """Names of one kind of rig.

    Attributes
    ----------
    label, description : str
        The rig's name and a remark, as shown to the animator.
    bones : mapping of str to tuple of str
        Names by role. A rig may lack bones of roles that are not required, and bones of chains.
    settings : mapping of str to mapping of str to float
        By bone, the values that its custom properties must have while the controls are driven.
    follows : mapping of str to str
        By control, the bone that shows the control's effect, if it is not the control itself.
    ik : tuple of IkLimb
        Limbs that are driven through IK controls instead of the bones of their roles.
    """

    label: str
    description: str
    bones: Mapping[str, tuple[str, ...]]
    settings: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    follows: Mapping[str, str] = field(default_factory=dict)
    ik: tuple[IkLimb, ...] = ()


def _by_role(names: Names) -> dict[str, tuple[str, ...]]:
    """Return names by role for both sides, from names by role without a side."""
    found: dict[str, tuple[str, ...]] = {}
    for role in PARENTS:
        base, _, side = role.partition(".")
        given = names.get(base, ())
        listed = (given,) if isinstance(given, str) else tuple(given)
        if listed:
            found[role] = tuple(name.format(**_WORDS[side]) if side else name for name in listed)
    assert all(len(v) == 1 or role in CHAINS for role, v in found.items())
    return found


def _fingers(pattern: str, words: Sequence[str], joints: Sequence[str] = ("1", "2", "3")) -> dict[str, list[str]]:
    """Return the names of the fingers' bones, thumb first; {f} stands for the finger, {j} for the joint."""
    return {
        finger: [pattern.replace("{f}", word).replace("{j}", joint) for joint in joints]
        for finger, word in zip(FINGERS, words, strict=True)
    }


_TITLES = ("Thumb", "Index", "Middle", "Ring", "Pinky")
_FINGER_TITLES = ("Thumb", "Index", "Middle", "Ring", "Little")
_RIGIFY_FINGERS = _fingers("{f}.{j}.{S}", ("thumb", "f_index", "f_middle", "f_ring", "f_pinky"), ("01", "02", "03"))

_KFMOCAP = _by_role(
    {
        "hips": "pelvis",
        "spine": ["spine", "chest"],
        "neck": ["neck"],
        "head": "head",
        **{
            role: f"{role}.{{S}}"
            for role in ("shoulder", "upper_arm", "forearm", "hand", "thigh", "shin", "foot", "toe")
        },
        **_RIGIFY_FINGERS,
    }
)
_METARIG = _by_role(
    {
        "hips": "spine",
        "spine": ["spine.001", "spine.002", "spine.003"],
        "neck": ["spine.004", "spine.005"],
        "head": "spine.006",
        **{
            role: f"{role}.{{S}}"
            for role in ("shoulder", "upper_arm", "forearm", "hand", "thigh", "shin", "foot", "toe")
        },
        **_RIGIFY_FINGERS,
    }
)
_RIGIFY = _by_role(
    {
        "root": "root",
        "hips": "torso",
        "spine": ["spine_fk.002", "spine_fk.003"],
        "neck": ["neck"],
        "head": "head",
        "shoulder": "shoulder.{S}",
        **{role: f"{role}_fk.{{S}}" for role in ("upper_arm", "forearm", "hand", "thigh", "shin", "foot", "toe")},
        **_RIGIFY_FINGERS,
    }
)
_RIGIFY_FOLLOWS = {
    "torso": "ORG-spine",
    "spine_fk.003": "ORG-spine.003",
    "head": "ORG-spine.006",
    **{
        f"{role}_fk.{side}": f"ORG-{role}.{side}"
        for role in ("upper_arm", "forearm", "hand", "thigh", "shin", "foot", "toe")
        for side in "LR"
    },
    **{f"shoulder.{side}": f"ORG-shoulder.{side}" for side in "LR"},
}


_POLES = {"pole_vector": 1.0, "IK_Stretch": 0.0, "IK_parent": 1.0, "pole_parent": 1.0}
"""Limbs bend towards their pole targets, which have the root as parent, like the controls of hands and feet."""


def _rigify_settings(fk: float) -> dict[str, dict[str, float]]:
    limbs = {
        f"{limb}_parent.{side}": {
            "IK_FK": fk,
            "FK_limb_follow": 0.0,
            **({} if fk else _POLES),
        }
        for limb in ("upper_arm", "thigh")
        for side in "LR"
    }
    return {"torso": {"neck_follow": 1.0, "head_follow": 1.0}, **limbs}


_RIGIFY_IK = tuple(
    IkLimb(
        f"{upper}.{side}",
        f"{lower}.{side}",
        f"{end}.{side}",
        control=f"{control}.{side}",
        pole=f"{pole}.{side}",
        twist=f"{lower}_tweak.{side}",
        beyond=(f"toe.{side}", f"toe_ik.{side}") if end == "foot" else None,
    )
    for upper, lower, end, control, pole in (
        ("upper_arm", "forearm", "hand", "hand_ik", "upper_arm_ik_target"),
        ("thigh", "shin", "foot", "foot_ik", "thigh_ik_target"),
    )
    for side in "LR"
)
_MIXAMO = _by_role(
    {
        "hips": "mixamorig:Hips",
        "spine": ["mixamorig:Spine", "mixamorig:Spine1", "mixamorig:Spine2"],
        "neck": ["mixamorig:Neck"],
        "head": "mixamorig:Head",
        "shoulder": "mixamorig:{Side}Shoulder",
        "upper_arm": "mixamorig:{Side}Arm",
        "forearm": "mixamorig:{Side}ForeArm",
        "hand": "mixamorig:{Side}Hand",
        "thigh": "mixamorig:{Side}UpLeg",
        "shin": "mixamorig:{Side}Leg",
        "foot": "mixamorig:{Side}Foot",
        "toe": "mixamorig:{Side}ToeBase",
        **_fingers("mixamorig:{Side}Hand{f}{j}", _TITLES),
    }
)
_UNREAL = _by_role(
    {
        "root": "root",
        "hips": "pelvis",
        "spine": [f"spine_0{k}" for k in range(1, 6)],
        "neck": ["neck_01", "neck_02"],
        "head": "head",
        "shoulder": "clavicle_{s}",
        "upper_arm": "upperarm_{s}",
        "forearm": "lowerarm_{s}",
        "hand": "hand_{s}",
        "thigh": "thigh_{s}",
        "shin": "calf_{s}",
        "foot": "foot_{s}",
        "toe": "ball_{s}",
        **_fingers("{f}_{j}_{s}", ("thumb", "index", "middle", "ring", "pinky"), ("01", "02", "03")),
    }
)
_UNITY = _by_role(
    {
        "hips": "Hips",
        "spine": ["Spine", "Chest", "UpperChest"],
        "neck": ["Neck"],
        "head": "Head",
        "shoulder": "{Side}Shoulder",
        "upper_arm": "{Side}UpperArm",
        "forearm": "{Side}LowerArm",
        "hand": "{Side}Hand",
        "thigh": "{Side}UpperLeg",
        "shin": "{Side}LowerLeg",
        "foot": "{Side}Foot",
        "toe": "{Side}Toes",
        **_fingers("{Side}{f}{j}", _FINGER_TITLES, ("Proximal", "Intermediate", "Distal")),
        # Unity and VRM 0 call a thumb's bones as those of fingers, VRM 1.0 calls them metacarpal, proximal and distal.
        "thumb": [f"{{Side}}Thumb{joint}" for joint in ("Metacarpal", "Proximal", "Intermediate", "Distal")],
    }
)
_VROID = _by_role(
    {
        "root": "Root",
        "hips": "J_Bip_C_Hips",
        "spine": ["J_Bip_C_Spine", "J_Bip_C_Chest", "J_Bip_C_UpperChest"],
        "neck": ["J_Bip_C_Neck"],
        "head": "J_Bip_C_Head",
        "shoulder": "J_Bip_{S}_Shoulder",
        "upper_arm": "J_Bip_{S}_UpperArm",
        "forearm": "J_Bip_{S}_LowerArm",
        "hand": "J_Bip_{S}_Hand",
        "thigh": "J_Bip_{S}_UpperLeg",
        "shin": "J_Bip_{S}_LowerLeg",
        "foot": "J_Bip_{S}_Foot",
        "toe": "J_Bip_{S}_ToeBase",
        **_fingers("J_Bip_{S}_{f}{j}", _FINGER_TITLES),
    }
)
_MAKEHUMAN = _by_role(
    {
        "hips": "root",
        "spine": [f"spine0{k}" for k in range(5, 0, -1)],
        "neck": ["neck01", "neck02", "neck03"],
        "head": "head",
        "shoulder": "clavicle.{S}",
        "upper_arm": "upperarm01.{S}",
        "forearm": "lowerarm01.{S}",
        "hand": "wrist.{S}",
        "thigh": "upperleg01.{S}",
        "shin": "lowerleg01.{S}",
        "foot": "foot.{S}",
        **_fingers("finger{f}-{j}.{S}", ("1", "2", "3", "4", "5")),
    }
)

PRESETS: Mapping[str, BonePreset] = {
    "kfmocap": BonePreset("KF Mocap", "A body of this add-on", _KFMOCAP),
    "rigify": BonePreset(
        "Rigify", "A generated rig, through its FK controls", _RIGIFY, _rigify_settings(1.0), _RIGIFY_FOLLOWS
    ),
    "rigify-ik": BonePreset(
        "Rigify, IK Limbs",
        "A generated rig, arms and legs through their IK controls",
        _RIGIFY,
        _rigify_settings(0.0),
        _RIGIFY_FOLLOWS
        | {f"{lower}_fk.{side}": f"DEF-{lower}.{side}" for lower in ("forearm", "shin") for side in "LR"},
        ik=_RIGIFY_IK,
    ),
    "rigify-metarig": BonePreset("Rigify Metarig", "The metarig that a rig is generated from", _METARIG),
    "mixamo": BonePreset("Mixamo", "Bones named mixamorig:Hips and so on", _MIXAMO),
    "unreal": BonePreset("Unreal", "Unreal's mannequin", _UNREAL),
    "unity": BonePreset("Unity Humanoid", "Bones named as in Unity's humanoid avatar, or by the VRM standard", _UNITY),
    "vrm": BonePreset("VRM", "Bones named as VRoid names them", _VROID),
    "makehuman": BonePreset("MakeHuman", "MakeHuman's default rig", _MAKEHUMAN),
}
"""The presets by their names on the command line and in bone maps; if several fit a rig equally well, the first is
used.

Saved Blender files store the index of a preset in this list, so new ones must be added at its end.
"""
