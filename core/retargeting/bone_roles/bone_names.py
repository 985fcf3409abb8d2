"""Roles of bones by their names: what a word means depends on the rig's other words and on its hierarchy.

One rig's shoulder is a collar bone, another's the upper arm above an elbow; a leg is a shin below a thigh, or a thigh
above a knee. A control rig has every limb several times, so a skeleton is searched for among bones of one kind.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace

from ...body.skeleton_motion import RestSkeleton
from .bone_words import BoneName, read_name, shared_words
from .roles import FINGERS, PARENTS, SIDES, BoneMap, parent_role
from .skeleton_tree import SkeletonTree

_FAMILIES: tuple[frozenset[str], ...] = tuple(
    frozenset(kinds)
    for kinds in (
        ("",),
        ("def",),
        ("", "def"),
        ("", "stretch"),
        ("org",),
        ("", "org"),
        ("", "fk"),
        ("", "control"),
        ("", "def", "org", "fk", "control"),
    )
)
"""Sets of kinds of bones among which a skeleton is searched for, in order. Bones moved by constraints come before
controls, which are found later by moving them."""
_GROUND_SHARE = 0.05
"""Share of the hips' height below which a bone stands on the ground."""
_MAX_BONES = {"spine": 9, "neck": 9, **dict.fromkeys(FINGERS, 3)}

Named = Mapping[str, list[int]]


def roles_by_name(rest: RestSkeleton) -> BoneMap:
    """Return the roles that words in the bones' names suggest, preferring bones of one kind that make up a human.

    Words that most names share are read at first, too: a rig may have many hands or legs.
    """
    tree = SkeletonTree(rest)
    found = BoneMap({}, found_by="names")
    for shared in dict.fromkeys((frozenset[str](), shared_words(rest.names))):
        names = [read_name(name, shared) for name in rest.names]
        for kinds in _FAMILIES:
            one = BoneMap(_roles(rest, names, tree, kinds), found_by="names")
            if not one.missing():
                whole = BoneMap(_roles(rest, names, tree, _FAMILIES[-1]), found_by="names")
                return _with_head(completed(one, whole, rest))
            if len(one.missing()) < len(found.missing()) or not found.bones:
                found = one
    return found


def _with_head(bones: BoneMap) -> BoneMap:
    """Return a map in which the last bone of a neck is the head, where no other is: it carries the face."""
    neck = bones.bones.get("neck", ())
    if not neck or "head" in bones.bones:
        return bones
    others = {role: names for role, names in bones.bones.items() if role != "neck"}
    return replace(bones, bones=others | {"head": neck[-1:]} | ({"neck": neck[:-1]} if neck[1:] else {}))


def completed(bones: BoneMap, more: BoneMap, rest: RestSkeleton) -> BoneMap:
    """Return a map with roles that it lacks, and chains of which it has a part, as another one has them, where these
    bones have no other role and hang on that of the role above.
    """
    tree, found = SkeletonTree(rest), dict(bones.bones)
    for role in PARENTS:
        wanted, own, above = more.bones.get(role, ()), found.get(role, ()), found.get(parent_role(role, found), ())
        if not above or len(wanted) <= len(own) or not set(own) <= set(wanted):
            continue
        others = {name for other, played in found.items() if other != role for name in played}
        [top, *_], [*_, carrier] = rest.indices(wanted), rest.indices(above)
        if not others & set(wanted) and tree.is_above(carrier, top):
            found[role] = wanted
    return BoneMap(found, bones.preset, bones.found_by)


def _roles(
    rest: RestSkeleton, names: Sequence[BoneName], tree: SkeletonTree, kinds: Collection[str]
) -> dict[str, tuple[str, ...]]:
    parts: dict[str, dict[str, list[int]]] = {"": {}, "L": {}, "R": {}}
    for j, name in enumerate(names):
        if name.part and (name.kind in kinds or name.part == "root"):
            parts[name.side].setdefault(name.part, []).append(j)
    central = {role: parts[""][role][:1] for role in ("root", "hips", "head") if role in parts[""]}
    central |= {role: tree.chain(parts[""][role], _MAX_BONES[role]) for role in ("spine", "neck") if role in parts[""]}
    found = dict(central)
    for side in SIDES:
        limb = {part: _lowest_numbered(bones, names, tree) for part, bones in parts[side].items() if part != "toe"}
        limb |= {"toe": parts[side]["toe"]} if "toe" in parts[side] else {}
        limbs = _leg(limb, tree) | _arm(limb, tree) | _fingers(parts[side], names, tree)
        found |= {f"{role}.{side}": bones for role, bones in limbs.items()}
    tops = [
        found[role][0] for role in (f"{limb}.{s}" for limb in ("thigh", "upper_arm") for s in SIDES) if role in found
    ]
    if carrying := [j for j in parts[""].get("hips", []) if all(tree.is_above(j, top) for top in tops)]:
        found["hips"] = carrying[-1:]  # the nearest to them: a centre of gravity may be above hips
    if tree.says_nothing(found):
        for role in ("spine", "neck"):
            upward = sorted(parts[""].get(role, []), key=lambda j: float(rest.heads[j, 2]))
            found |= {role: upward[: _MAX_BONES[role]]} if upward else {}
    found = tree.with_trunk(found)
    root = _root(rest, parts[""].get("root", []), found.get("hips", []), tree)
    found = {role: bones for role, bones in found.items() if role != "root"} | ({"root": root} if root else {})
    return {role: tuple(rest.names[j] for j in bones) for role, bones in found.items()}


def _root(rest: RestSkeleton, named: Sequence[int], hips: Sequence[int], tree: SkeletonTree) -> list[int]:
    """Return the bone that carries the whole rig: one that is called root, above the hips, or beside them as in rigs
    whose bones follow controls; else the one next above that stands on the ground.
    """
    if not hips:
        return list(named[:1])
    above, heights = tree.above(hips[0]), rest.heads[:, 2] - rest.heads[:, 2].min()
    on_ground = [j for j in above if heights[j] < _GROUND_SHARE * heights[hips[0]]]
    beside = [j for j in named if j != hips[0] and not tree.is_above(hips[0], j)]
    return [j for j in named if j in above][:1] or beside[:1] or on_ground[:1]


def _leg(parts: Named, tree: SkeletonTree) -> dict[str, list[int]]:
    """Return thigh, shin, foot and toe of one side."""
    lower = [*parts.get("shin", []), *parts.get("knee", [])]
    legs = parts.get("leg", [])
    thighs = parts.get("thigh", [])
    if not thighs and lower and legs:
        thighs, legs = legs, []
    if not thighs and not lower and (second := _second(legs, tree)):
        thighs, legs = legs[:1], second
    shins, hips = sorted([*lower, *legs]), parts.get("hips", [])
    thighs = tree.carrying(thighs, shins) or tree.carrying(hips, shins) or thighs or (hips if shins else [])
    ankles, feet, toes = (parts.get(part, []) for part in ("ankle", "foot", "toe"))
    below = [j for j in feet if ankles and tree.is_above(ankles[0], j)]
    below = tree.carrying(below, toes) or below
    found = {"thigh": thighs[:1], "shin": shins[:1], "foot": sorted([*ankles, *feet])[:1]}
    found["toe"] = sorted([*below, *toes])[:1] if below else toes[:1]
    return {role: bones for role, bones in found.items() if bones}


def _arm(parts: Named, tree: SkeletonTree) -> dict[str, list[int]]:
    """Return collar bone, upper arm, forearm and hand of one side."""
    arms = parts.get("arm", [])
    uppers = parts.get("upper_arm", []) or arms
    lowers = sorted([*parts.get("forearm", []), *parts.get("elbow", [])])
    lowers = lowers or [j for j in arms if tree.carrying(parts.get("upper_arm", []), [j])] or _second(uppers, tree)
    shoulders, collars = parts.get("shoulder", []), parts.get("collar", [])
    above = tree.carrying(shoulders, lowers[:1])
    if lowers and (not uppers or (above and not tree.carrying(uppers, lowers))):
        uppers = (above or shoulders)[-1:]
        shoulders = [j for j in shoulders if j not in uppers]
    hands = sorted([*parts.get("hand", []), *parts.get("wrist", [])]) or parts.get("palm", [])
    found = {"shoulder": (collars or shoulders)[:1], "upper_arm": uppers[:1], "forearm": lowers[:1], "hand": hands[:1]}
    return {role: bones for role, bones in found.items() if bones}


def _lowest_numbered(bones: Sequence[int], names: Sequence[BoneName], tree: SkeletonTree) -> list[int]:
    """Return the bones of one name with the lowest number, and those that hang on them: others are of further limbs."""
    numbers = [int(names[j].digits or 0) for j in bones]
    lowest = [j for j, number in zip(bones, numbers, strict=True) if number == min(numbers)]
    return [j for j in bones if j in lowest or any(tree.is_above(k, j) for k in lowest)]


def _second(bones: Sequence[int], tree: SkeletonTree) -> list[int]:
    """Return the lower of two bones of the same name, of which one hangs on the other; nothing if they are not two."""
    return tree.chain(bones, 2)[1:] if len(bones) == 2 else []


def _fingers(parts: Named, names: Sequence[BoneName], tree: SkeletonTree) -> dict[str, list[int]]:
    """Return the fingers of one side, by their names or by numbers from the thumb on."""
    found = {finger: tree.chain(parts[finger], _MAX_BONES[finger]) for finger in FINGERS if finger in parts}
    numbered: dict[int, list[int]] = {}
    feet = [*parts.get("ankle", []), *parts.get("foot", [])]
    for j in parts.get("finger", []):
        if not tree.carrying(feet, [j]):  # no toe
            numbered.setdefault(int(names[j].digits[0]), []).append(j)
    if numbered and found and not {"middle", "ring", "pinky"} & set(found):
        found["middle"] = tree.chain(next(iter(numbered.values())), 3)  # one for the three, as in a mitten
    if not found and numbered and min(numbered) <= 1:
        first = min(numbered)
        for k, bones in numbered.items():
            if k - first < len(FINGERS):
                found[FINGERS[k - first]] = tree.chain(bones, 3)
    return found
