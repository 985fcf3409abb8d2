"""Reading the name of a bone: its side, the part of the body that it names, and its function in a rig."""

from __future__ import annotations

import re
from dataclasses import dataclass

NAMESPACE = re.compile(r"^.*[:|]")
"""What comes before a bone's name in files of other programs, as in mixamorig:Hips."""
_TOKEN = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+|\d+|[^\W\d_a-zA-Z]+")
_SIDES = {
    **dict.fromkeys(("l", "left", "lf", "lft", "lt", "左"), "L"),
    **dict.fromkeys(("r", "right", "rt", "rgt", "rg", "右"), "R"),
}
_MADE = re.compile(
    r"^(bip|valve|biped|j|b|m|cc|base|bn|bone|joint|jnt|jt|sh|bind|skin|sk|x|character|valvebiped"
    r"|mstr|main)$"
)
_NUMBERED = re.compile(r"^(bip|biped|character)$")
_KINDS = {
    "fk": "fk",
    **dict.fromkeys(("c", "ctrl", "ctl", "control", "con"), "control"),
    **dict.fromkeys(("def", "deform"), "def"),
    "org": "org",
}
_DECIDING_KINDS = frozenset(["fk", "helper"])
"""Kinds that count whatever else the name says."""
_CENTRE = "C"
"""Begins the names of bones in the middle where those of the sides begin with L and R."""
_HELPERS = re.compile(
    r"^(ik|ikhandle|mch|tgt|target|pole|tweak|twist\d*|twk|roll|share|corrective|cor|helper|helpers|volume|jiggle|spring"
    r"|nub|end|tip|eff|effector|sec|adj|metacarpals?|carpals?|metatarsals?|vis|driver|offset|stretch|scale|parent|prop"
    r"|pec|pectoral|breast|out|in|bck|fwd|lat|latissimus|scap|weapon|drehung|ＩＫ|捩|親|キャンセル)$",
    re.IGNORECASE,
)
_BEND_ENDING = re.compile(r"(bend|base)$")

_WORDS: tuple[tuple[str, str], ...] = (
    ("root", r"root|master|reference|armature|全|全て|wurzel"),
    ("hips", r"hips?|pelvis|cog|bip\d*pelvis|lowertorso|lowerbody|下半身|becken|hüfte|huefte"),
    ("toe", r"toes?(base)?\d*|ball|toebone|つま先|zehen?"),
    ("foot", r"foot|feet|足首|fu(ß|ss)"),
    ("ankle", r"ankle"),
    ("shin", r"shin|calf|lowerleg|leglower|lowleg|crus|unterschenkel"),
    ("knee", r"knee|ひざ|膝|knie"),
    ("leg", r"leg|bein"),
    ("thigh", r"thigh|upleg|upperleg|legupper|femur|足|oberschenkel"),
    ("thumb", r"(hand)?thumb\d*|親指|daumen\d*"),
    ("index", r"(hand|f)?(index|pointer|fore)(finger)?\d*|人指|人差指|人差し指|zeigefinger\d*"),
    ("middle", r"(hand|f)?(middle|mid)(finger)?\d*|中指|mittelfinger\d*"),
    ("ring", r"(hand|f)?ring(finger)?\d*|薬指"),
    ("pinky", r"(hand|f)?(pinky|little|pinkie|small)(finger)?\d*|小指|kleine?finger\d*"),
    ("finger", r"finger\d+"),
    ("hand", r"hand"),
    ("wrist", r"wrist|手首|handgelenk"),
    ("forearm", r"forearm|lowerarm|armlower|lowarm|ひじ|肘|unterarm"),
    ("elbow", r"elbow|ell(en)?bogen"),
    ("upper_arm", r"upperarm|uparm|armupper|humerus|腕|shldr|oberarm"),
    ("arm", r"arm"),
    ("shoulder", r"shoulder|肩|schulter"),
    ("collar", r"clavicle|collar|clav|collarbone|scapula|schl(ü|ue)sselbein"),
    ("head", r"head\d*|頭|kopf"),
    ("neck", r"neck(lower|upper)?\d*|首|hals|nacken"),
    (
        "spine",
        r"(spine|(upper|lower)?chest|(upper|lower)?torso|abdomen|waist|lowerback|back|ribcage|thorax|trunk|belly|(upper)?body"
        r"|wirbels(ä|ae)ule|brust(korb)?|bauch|r(ü|ue)cken|上半身)(lower|upper)?\d*",
    ),
)
"""Parts of a body and patterns of their words, matched with names without namespace, side and function."""


@dataclass(frozen=True)
class BoneName:
    """The meaning of a bone's name.

    Attributes
    ----------
    side : str
        "L", "R" or empty.
    part : str
        A part of `_WORDS`, or empty. For limbs it is either the segment or the joint at which it begins, as a shin may
        be called knee.
    kind : str
        Empty for a plain bone, "def" for a deforming one, "org" for one that deforming bones copy, "fk" and "control"
        for controls, "helper" for bones that do not belong to the skeleton, such as twist bones.
    digits : str
        The numbers after the part's word.
    """

    side: str
    part: str
    kind: str
    digits: str


def read_name(name: str) -> BoneName:
    """Read a bone's name, whatever the rig's conventions."""
    tokens, side, kind, central = _tokens(name), "", "", False
    kept: list[str] = []
    for before, token in zip(["", *tokens], tokens, strict=False):
        small = token.lower()
        if token.isdigit() and _NUMBERED.match(before.lower()):
            continue
        if small in _SIDES and not side:
            side = _SIDES[small]
        elif token == _CENTRE and not before:
            central = True
        elif of := _kind_of(small):
            kind = of if of in _DECIDING_KINDS else kind or of
        elif not (_MADE.match(small) and len(tokens) > 1):
            kept.append(small)
    if central and side:  # no centre, but the controls of a side
        kind = kind or "control"
    word = "".join(kept)
    part = _part_of(word)
    if not part and (bare := _BEND_ENDING.sub("", word)) != word:
        part = _part_of(bare)
    if not part and (bare := word.rstrip("0123456789")) != word:
        part = _part_of(bare)
    if kind == "helper" and part == "neck" and not side:
        kind = ""  # some rigs call the neck's own bones twist bones
    found = re.search(r"\d+$", word)
    return BoneName(side, part, kind, found.group() if found else "")


def _kind_of(word: str) -> str:
    """Return the kind of bone that a word in a name stands for, see `BoneName`; nothing where it stands for none."""
    return "helper" if _HELPERS.match(word) else _KINDS.get(word, "")


def _tokens(name: str) -> list[str]:
    """Split a name into words, numbers and single letters, with marks of the side separated."""
    plain = NAMESPACE.sub("", name)
    found: list[str] = []
    for token in _TOKEN.findall(plain):
        small = token.lower()
        if token[:1] in "左右" and len(token) > 1:
            found += [token[0], *_apart(token[1:])]
        elif token.isupper() and len(token) > 2:  # one word in capitals, or several
            found += _capitals(small)
        elif match := re.fullmatch(r"(left|right)(\w+)|(\w+?)(left|right)", small):
            found += [part for part in match.groups() if part]
        else:
            found += _apart(token)
    return found


def _apart(token: str) -> list[str]:
    """Split the function off the end of a word in a script without upper and lower case."""
    match = re.fullmatch(r"(.*?)(ＩＫ|捩|親|キャンセル)", token)
    return [part for part in match.groups() if part] if match else [token]


def _capitals(word: str) -> list[str]:
    match = re.fullmatch(r"(left|right)(\w+)|(\w+?)(left|right)", word)
    return [part for part in match.groups() if part] if match else [word]


def _part_of(word: str) -> str:
    return next((part for part, pattern in _WORDS if re.fullmatch(pattern, word)), "")
