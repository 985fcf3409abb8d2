"""Reading the name of a bone: its side, the part of the body that it names, and its function in a rig."""

from __future__ import annotations

import re
import unicodedata
from collections import Counter
from collections.abc import Collection, Sequence
from dataclasses import dataclass

from .bone_vocabulary import SIDES, WORDS
from .roles import FINGERS

NAMESPACE = re.compile(r"^.*[:|]")
"""What comes before a bone's name in files of other programs, as in mixamorig:Hips."""
_REMARK = re.compile(r"\[(?!(l|r|left|right)\]).*?\]|\((?!(l|r|left|right)\)).*?\)", re.IGNORECASE)
_TOKEN = re.compile(
    r"(?<![A-Za-z])(?:L(?![FT])|R(?![TG]))(?=[A-Z][A-Z][a-z])|[A-Z]+(?![a-z])|[A-Z]?[a-z]+|\d+"
    r"|[А-ЯЁ]?[а-яё]+|[^\W\d_a-zA-Zа-яё]+"
)
"""Words, numbers, and a mark of the side before a single letter, as in LUArm."""
_ACCENTED = re.compile(r"([a-zA-Z])[\u0300-\u036f]+")
_MADE = re.compile(
    r"^(bip|valve|biped|j|b|m|cc|base|bn|bone|joint|jnt|jt|sh|bind|skin|sk|x|character|valvebiped"
    r"|mstr|main|mixamorig)$"
)
_NUMBERED = re.compile(r"^(bip|biped|character)$")
_KINDS = {
    "fk": "fk",
    **dict.fromkeys(("c", "ctrl", "ctl", "control", "con"), "control"),
    **dict.fromkeys(("def", "deform"), "def"),
    "org": "org",
    "stretch": "stretch",
}
_DECIDING_KINDS = frozenset(["fk", "helper"])
"""Kinds that count whatever else the name says."""
_CENTRE = "C"
"""Begins the names of bones in the middle where those of the sides begin with L and R, or is numbered as these are."""
_CENTRES = frozenset(["cn", "ctr", "cen", "cent", "md"])
_LETTERS = [*"abcdefg"]
_LETTERED = frozenset(["spine", "neck", "head", *FINGERS])
"""Letters number the bones of chains in some rigs, as in spineA, headA and thumb_b."""
_HELPERS = re.compile(
    r"^(ik|ikhandle|mch|tgt|target|pole|tweak|twist\d*|twk|roll|share|corrective|cor|helper|helpers|volume|jiggle|spring"
    r"|nub|end|tip|eff|effector|sec|adj|metacarpals?|carpals?|metatarsals?|vis|driver|offset|scale|parent|prop"
    r"|pec|pectoral|breast|out|in|bck|fwd|lat|latissimus|scap|weapon|drehung|giro|torsione?|torcao|скрутка"
    r"|捩|親|キャンセル)$",
    re.IGNORECASE,
)
_BEND_ENDING = re.compile(r"(bend|base)$")
_REGION = re.compile(r"^(arm|leg)(?=.)|^hand(?=wrist|palm)|^foot(?=ankle|ball|toe)")
_PHALANX_ENDING = re.compile(r"(?<=\d)(proximal|intermediate|medial|distal)$")
_METACARPAL = re.compile(r"metacarpals?", re.IGNORECASE)
_NEARLY_ALL = 0.9  # share of the names


@dataclass(frozen=True)
class BoneName:
    """The meaning of a bone's name.

    Attributes
    ----------
    side : str
        "L", "R" or empty.
    part : str
        A part of `bone_vocabulary.WORDS`, or empty. For limbs it is either the segment or the joint at which it begins,
        as a shin may be called knee.
    kind : str
        Empty for a plain bone, "def" for a deforming one, "stretch" for one that is stretched and may deform the skin,
        "org" for one that deforming bones copy, "fk" and "control" for controls, "helper" for bones that do not belong
        to the skeleton, such as twist bones.
    digits : str
        The numbers after the part's word.
    """

    side: str
    part: str
    kind: str
    digits: str


def read_name(name: str, shared: Collection[str] = ()) -> BoneName:
    """Read a bone's name, whatever the rig's conventions.

    Parameters
    ----------
    name : str
    shared : collection of str
        Words that say nothing, see `shared_words`.
    """
    tokens, side, kind, central = _tokens(name), "", "", False
    kept: list[str] = []
    made: list[str] = []
    for before, token, after in zip(["", *tokens], tokens, [*tokens[1:], ""], strict=False):
        small = token.lower()
        if small in shared or (token.isdigit() and (before.lower() in shared or _NUMBERED.match(before.lower()))):
            continue
        if small in SIDES and not side:
            side = SIDES[small]
        elif (token == _CENTRE and (not before or after.isdigit())) or (small in _CENTRES and not before):
            central = True
        elif small in _LETTERS and _part_of(before.lower()) in _LETTERED:
            kept.append(str(_LETTERS.index(small) + 1))
        elif before == _CENTRE and token.isdigit():
            continue
        elif of := _kind_of(small):
            kind = of if of in _DECIDING_KINDS else kind or of
        else:
            (made if _MADE.match(small) and len(tokens) > 1 else kept).append(small)
    if central and side:  # no centre, but the controls of a side
        kind = kind or "control"
    if kept[:1] and _REGION.sub("", kept[0] + "x") == "x" and kept[0] in kept[1:]:
        kept = kept[1:]  # of the arm, the forearm
    word = _PHALANX_ENDING.sub("", "".join(dict.fromkeys(kept or made)))  # main is a hand in French
    plain = word.rstrip("0123456789")
    readings = (word, _BEND_ENDING.sub("", word), plain, _REGION.sub("", word), _REGION.sub("", plain))
    part = next((part for reading in readings if (part := _part_of(reading))), "")
    first_of_thumb = part == "thumb" and any(map(_METACARPAL.fullmatch, tokens))
    if kind == "helper" and (first_of_thumb or (part == "neck" and not side)):
        kind = ""  # some rigs call the neck's own bones twist bones
    found = re.search(r"\d+$", word)
    return BoneName(side, part, kind, found.group() if found else "")


def shared_words(names: Sequence[str]) -> frozenset[str]:
    """Return the words that most names of a rig have, such as a character's, and that say nothing of a bone.

    A word that may stand for a part of the body says nothing only where nearly all of the names have it.
    """
    counts = Counter(word for name in names for word in {token.lower() for token in _tokens(name)})
    return frozenset(
        word
        for word, count in counts.items()
        if count > (_NEARLY_ALL if _part_of(word) or _part_of(f"{word}1") else 0.5) * len(names) and word not in SIDES
    )


def _kind_of(word: str) -> str:
    """Return the kind of bone that a word in a name stands for, see `BoneName`; nothing where it stands for none."""
    return "helper" if _HELPERS.match(word) else _KINDS.get(word, "")


def _tokens(name: str) -> list[str]:
    """Split a name into words, numbers and single letters, with marks of the side separated."""
    unaccented = _ACCENTED.sub(r"\1", unicodedata.normalize("NFD", name))
    plain = _REMARK.sub("", NAMESPACE.sub("", unicodedata.normalize("NFKC", unaccented)))
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
    match = re.fullmatch(r"(.*?)(捩|親|キャンセル)", token)
    return [part for part in match.groups() if part] if match else [token]


def _capitals(word: str) -> list[str]:
    match = re.fullmatch(r"(left|right)(\w+)|(\w+?)(left|right)", word)
    return [part for part in match.groups() if part] if match else [word]


def _part_of(word: str) -> str:
    return next((part for part, patterns in WORDS if any(re.fullmatch(each, word) for each in patterns)), "")
