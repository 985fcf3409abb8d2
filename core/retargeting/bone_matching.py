"""Which bones play which roles: by a preset's names, else by words in the names, else by their place at rest."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from types import MappingProxyType

from ..body.skeleton_motion import RestSkeleton
from ..errors import BodyError
from .bone_places import roles_by_place
from .bone_presets import PRESETS, BonePreset
from .roles import CHAINS, FINGERS, SIDES, BoneMap

_NAMESPACE = re.compile(r"^.*[:|]")
_SIDE = re.compile(r"(?:^|[_.\- ])(l|r|left|right)(?=$|[_.\- ])", re.IGNORECASE)
_SIDE_WORD = re.compile(r"(left|right)", re.IGNORECASE)
_WORDS: tuple[tuple[str, str], ...] = (
    ("root", r"root|master|reference|armature"),
    ("hips", r"hips?(joint)?|pelvis|cog|bip\d*pelvis"),
    ("toe", r"toes?(base)?\d*|ball|toebone"),
    ("foot", r"foot|ankle|feet"),
    ("shin", r"shin|calf|lowerleg|leglower|lowleg|knee|crus|leg"),
    ("thigh", r"thigh|upleg|upperleg|legupper|femur"),
    ("thumb", r"(hand)?thumb\d*"),
    ("index", r"(hand|f)?(index|pointer|fore)(finger)?\d*"),
    ("middle", r"(hand|f)?(middle|mid)(finger)?\d*"),
    ("ring", r"(hand|f)?ring(finger)?\d*"),
    ("pinky", r"(hand|f)?(pinky|little|pinkie|small)(finger)?\d*"),
    ("hand", r"hand|wrist"),
    ("forearm", r"forearm|lowerarm|armlower|lowarm|elbow"),
    ("upper_arm", r"upperarm|uparm|armupper|arm|humerus"),
    ("shoulder", r"shoulder|clavicle|collar|clav|collarbone"),
    ("head", r"head"),
    ("neck", r"neck\d*"),
    ("spine", r"(spine|chest|upperchest|torso|abdomen|waist|lowerback|back|ribcage|thorax|trunk|belly|body)\d*"),
)
"""Roles and the words that name them, compared with a whole name without its namespace, side and separators."""

_NAMED_AFTER_JOINT: Mapping[str, str] = MappingProxyType({"upper_arm": "shoulder", "thigh": "hips"})
_BELOW: Mapping[str, str] = MappingProxyType({"upper_arm": "forearm", "thigh": "shin"})


def match_bones(rest: RestSkeleton, preset: str | None = None, where: str = "skeleton") -> BoneMap:
    """Find which bones play which roles.

    Parameters
    ----------
    rest : RestSkeleton
        Facing any way, Z up.
    preset : str, optional
        Name of the preset to use; by default the one that knows most of the bones, then names, then places.
    where : str
        What the bones are of, for errors.

    Raises
    ------
    BodyError
        The preset is unknown, or bones that it needs are missing; or no required roles are found in any way.
    """
    if preset is not None:
        if preset not in PRESETS:
            raise BodyError(f"there is no preset '{preset}'", where=where, todo=f"choose {', '.join(PRESETS)}")
        return by_preset(rest.names, preset).checked(rest.names, where)
    found = [by_preset(rest.names, name) for name in PRESETS]
    whole = [one for one in found if not one.missing()]
    if whole:
        return max(whole, key=lambda one: len(one.names()))
    by_names = roles_by_name(rest)
    if not by_names.missing():
        return by_names
    places = roles_by_place(rest)
    if not places:
        return by_names.checked(rest.names, where)
    return BoneMap(places, found_by="places").checked(rest.names, where)


def preset_of(bones: BoneMap) -> BonePreset:
    """Return the preset whose controls a map names; one without settings where it follows none."""
    return PRESETS.get(bones.preset, BonePreset("", {}))


def by_preset(names: Iterable[str], preset: str) -> BoneMap:
    """Return the bones that a preset names, whatever their namespace and case."""
    known: dict[str, str] = {}
    for name in reversed(list(names)):
        known[_plain(name)] = name
        known[name] = name
    bones = {}
    for role, wanted in PRESETS[preset].bones.items():
        there = [known.get(one, known.get(_plain(one))) for one in wanted]
        played = tuple(name for name in there if name is not None)
        if played:
            bones[role] = played
    return BoneMap(bones, preset)


def _plain(name: str) -> str:
    return _NAMESPACE.sub("", name).casefold()


def roles_by_name(rest: RestSkeleton) -> BoneMap:
    """Return the roles that the words in the bones' names suggest, the topmost bone of each.

    Many skeletons call their bones after the joints in which they begin: collar, shoulder, elbow, wrist, and hip,
    knee, ankle. There the bone that is called shoulder is the upper arm, and the one called hip the thigh.
    """
    bones: dict[str, list[str]] = {}
    joints: dict[str, list[str]] = {}
    for name in rest.names:
        side, word = _side_and_word(name)
        role = _role_of(word)
        if side and role in _NAMED_AFTER_JOINT.values():
            joints.setdefault(f"{role}.{side}", []).append(name)
        if role is None or (role in _central() and side):
            continue
        if role not in _central():
            if not side:
                continue
            role = f"{role}.{side}"
        listed = bones.setdefault(role, [])
        if not listed or (role in CHAINS and len(listed) < (3 if role.split(".")[0] in FINGERS else 9)):
            listed.append(name)
    for limb, joint in _NAMED_AFTER_JOINT.items():
        for side in SIDES:
            at_joint = _above(rest, joints.get(f"{joint}.{side}", ()), bones.get(f"{_BELOW[limb]}.{side}", ()))
            if at_joint and f"{limb}.{side}" not in bones:
                bones[f"{limb}.{side}"] = [at_joint.pop()]
                if joint not in _central():
                    bones[f"{joint}.{side}"] = at_joint[:1]
    return BoneMap({role: tuple(names) for role, names in bones.items() if names}, found_by="names")


def _above(rest: RestSkeleton, names: Sequence[str], below: Sequence[str]) -> list[str]:
    """Those of some bones from which another hangs, from the topmost down."""
    j, path = rest.names.index(below[0]) if below else -1, []
    while j >= 0:
        path.append(rest.names[j])
        j = rest.parents[j]
    return [name for name in reversed(path) if name in names]


def _central() -> frozenset[str]:
    return frozenset(["root", "hips", "spine", "neck", "head"])


def side_of_bone(name: str) -> str:
    """The side (L, R or nothing) that a bone's name tells, however the rig writes it."""
    return _side_and_word(name)[0]


def _side_and_word(name: str) -> tuple[str, str]:
    """Side (L, R or nothing) and the rest of a name in small letters without separators."""
    plain = _NAMESPACE.sub("", name)
    plain = re.sub(r"^(bip\d*|def|org|valvebiped|j_bip|jnt|bone|character\d*)[_.\- ]+", "", plain, flags=re.IGNORECASE)
    match = _SIDE.search(plain) or _SIDE_WORD.search(plain) or re.search(r"^([lr])(?=[A-Z])|[a-z]([LR])$", plain)
    side = ""
    if match:
        side = next(group for group in match.groups() if group)[0].upper()
        plain = plain[: match.start()] + ("" if match.end() == len(plain) else plain[match.end() :])
        if match.re.pattern.startswith("^([lr])") and match.group(2):  # a letter before the side belongs to the word
            plain = name[:-1]
    return side, re.sub(r"[^a-z0-9]", "", plain.casefold())


def _role_of(word: str) -> str | None:
    return next((role for role, pattern in _WORDS if re.fullmatch(pattern, word)), None)


def described(bones: BoneMap) -> Mapping[str, Sequence[str]]:
    """Return a map as plain lists by role, for reports and files."""
    return {role: list(bones.bones[role]) for role in bones.bones}
