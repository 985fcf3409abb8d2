"""The bones of a human that are parts of its body, and those whose skin belongs to these parts."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence

import bpy
import numpy as np

from ....core.errors import BodyError
from ....core.retargeting.bone_roles.roles import SIDES, BoneMap
from ..rigs.fk_controls import FkControls
from ..target_armatures import target_bones
from .rigify_animals import goes_on_four
from .tracked_bones import moves

PART_ROLES = ("hips", "spine", "neck", "head", "upper_arm", "forearm", "hand", "thigh", "shin", "foot")
_LIMB_ROLES = ("head", "upper_arm", "forearm", "hand", "thigh", "shin", "foot")
"""Roles of bones that are separate parts even if small, as on figures with large heads and short limbs."""
_TRUNK = ("hips", "spine", "neck")
_ENDS = ("head", "hand", "foot")
"""Roles of bones on which hair, fingers and toes hang."""
_HALVED = (("upper_arm", "forearm"), ("forearm", "hand"), ("thigh", "shin"), ("shin", "foot"))
"""Limbs of two bones each in some characters, such as those of Daz and MakeHuman, by their roles and the next one."""
_STRAIGHT = np.radians(15)
"""Largest angle between a limb and one of its two halves; the other may be short and askew."""
_NEAR = 1e-3
"""Share of a limb's length within which a bone begins where the limb does."""
_FINGERS = 3
"""Least number of bones that hang on a hand."""
_TAILS = ("tail", "schwanz", "rabo", "хвост", "尾")
"""Words in the names of bones on the hips that are a limb of their own."""


def limb_bones(armature: bpy.types.Object) -> BoneMap:
    """Return the bones that a human cannot do without; empty if the armature is not human."""
    try:
        bones = target_bones(armature).bones
    except BodyError:
        return BoneMap({})
    return BoneMap({role: names for role, names in bones.items() if role.partition(".")[0] in PART_ROLES})


def taken_in(armature: bpy.types.Object, bones: BoneMap) -> dict[str, str]:
    """Return the bones whose skin belongs to a part of a human though they may turn by themselves, and its bone: what
    hangs on head, hands and feet, and bones that halve limbs.
    """
    found, rest = dict[str, str](), armature.data.bones
    for end in (name for role, _, name in bones.items() if role.partition(".")[0] in _ENDS):
        found |= {bone.name: end for bone in rest[end].children_recursive}
    for upper, lower in ((f"{a}.{side}", f"{b}.{side}") for a, b in _HALVED for side in SIDES):
        if upper in bones.bones and lower in bones.bones:
            [first], [last] = bones.bones[upper], bones.bones[lower]
            line = rest[last].head_local - rest[first].head_local
            for bone in rest[last].parent_recursive:
                way = bone.head_local - rest[first].head_local
                if bone.name == first or rest[first] not in bone.parent_recursive:
                    break
                if way.length < _NEAR * line.length or min(way.angle(line), (line - way).angle(line, 0.0)) < _STRAIGHT:
                    found[bone.name] = first
    return found


def limbs_of(bones: BoneMap) -> list[str]:
    """Return the bones of a map that are separate parts even if small."""
    return [name for role, _, name in bones.items() if role.partition(".")[0] in _LIMB_ROLES]


def carried_along(armature: bpy.types.Object, bones: BoneMap) -> dict[str, str]:
    """Return the bones that are no part of a human's body, whatever they are called, and the bone that they go along
    with: what carries no limb, trunk or head, such as hair, skirts, capes and bags.

    Not those that keys turn, as the animator has posed them, nor a tail that is called so, nor further arms; nor what
    hangs on hands, feet and head, fingers included, see `taken_in`. None of an animal, whose head or limbs may be among
    them.
    """
    if not _is_whole(armature, bones):
        return {}
    rest, found = armature.data.bones, dict[str, str]()
    ends = [rest[name] for role, _, name in bones.items() if role.partition(".")[0] in _ENDS]
    on_ends = {bone.name for end in ends for bone in (end, *end.children_recursive)}
    body = set(target_bones(armature).names())  # collar bones, too
    needed = {above.name for name in body for above in (rest[name], *rest[name].parent_recursive)}
    for chain in _hung(rest, needed):
        of_body = chain[0].parent.name
        limb = _is_limb(chain) or (of_body in bones.bones["hips"] and _is_tail(chain[0]))
        if limb or of_body not in body - on_ends:
            continue
        for bone in chain:
            if not moves(armature, bone.name, "rotation"):
                stays = (above.name for above in bone.parent_recursive if above.name not in found)
                found[bone.name] = next(name for name in stays if name in body or name not in needed)
    return found


def controls_along(
    armature: bpy.types.Object, controls: FkControls, led: Collection[str], bones: BoneMap
) -> dict[str, str]:
    """Return the control that deforming bones go along with, by those that are no part of a human's body, on a rig of
    controls: those with a control of their own on the trunk, see `carried_along`.

    Parameters
    ----------
    controls : FkControls
        Of bones that lead skin, and of those that play a role.
    led : collection of str
        Bones that lead skin and are turned by controls.
    bones : BoneMap
        Of bones that follow the controls.
    """
    if not _is_whole(armature, bones):
        return {}
    rest, found = armature.data.bones, dict[str, str]()
    owner = {name: controls.by_bone.get(name, name) for name in bones.names()}
    trunk = {owner[name] for role in _TRUNK for name in bones.bones.get(role, ())}
    of_body = set(owner.values())
    owner |= {control: control for control in of_body}
    needed = {above.name for name in owner for above in (rest[name], *rest[name].parent_recursive)}
    for name in led:
        way = [rest[controls.by_bone[name]], *rest[controls.by_bone[name]].parent_recursive]
        at = next((k for k, bone in enumerate(way) if bone.name in owner), 0)
        carrier, top = owner.get(way[at].name, ""), way[at - 1]
        on_limb = controls.carried.get(name, carrier) in of_body - trunk
        if way[0].name in needed or carrier not in trunk or on_limb or _is_limb([top, *top.children_recursive]):
            continue
        if carrier in {owner[hips] for hips in bones.bones["hips"]} and _is_tail(top):
            continue
        # On what copies a control, nothing can be tracked.
        posed = [bone.name for bone in way[:at] if moves(armature, bone.name, "rotation")]
        posed = posed if way[at].name in of_body else []
        if way[0].name not in posed:
            found[name] = next(iter(posed), carrier)
    return found


def _is_whole(armature: bpy.types.Object, bones: BoneMap) -> bool:
    """Whether bones are those of a human with a head, who stands on two legs."""
    hands = "hand.L" in bones.bones and "hand.R" in bones.bones
    return "head" in bones.bones and not (hands and goes_on_four(armature, bones))


def _is_tail(bone: bpy.types.Bone) -> bool:
    return any(word in bone.name.casefold() for word in _TAILS)


def _is_limb(chain: Sequence[bpy.types.Bone]) -> bool:
    """Whether bones, each after those above, end in a hand: others, as skirts, branch where they begin."""
    return any(len(bone.children) >= _FINGERS and len(set(bone.parent_recursive) & {*chain}) > 1 for bone in chain)


def _hung(rest: bpy.types.ArmatureBones, needed: set[str]) -> Iterator[list[bpy.types.Bone]]:
    """Generate each bone that hangs on one of some bones and is none of them, with all that hangs on it."""
    for bone in rest:
        if bone.name not in needed and bone.parent is not None and bone.parent.name in needed:
            yield [bone, *bone.children_recursive]
