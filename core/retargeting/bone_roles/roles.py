"""Roles: the anatomical parts that the bones of a human skeleton represent, whatever their names.

Chains (spine, neck, fingers) are one role with several bones, from the hips or the hand outward.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from ...errors import BodyError

SIDES = ("L", "R")
FINGERS = ("thumb", "index", "middle", "ring", "pinky")
_LIMBS = {
    "shoulder": "spine",
    "upper_arm": "shoulder",
    "forearm": "upper_arm",
    "hand": "forearm",
    **dict.fromkeys(FINGERS, "hand"),
    "thigh": "hips",
    "shin": "thigh",
    "foot": "shin",
    "toe": "foot",
}
_CENTRAL = {"root": "", "hips": "root", "spine": "hips", "neck": "spine", "head": "neck"}


def _parents() -> dict[str, str]:
    found = dict(_CENTRAL)
    for name, parent in _LIMBS.items():
        for side in SIDES:
            found[f"{name}.{side}"] = parent if parent in _CENTRAL else f"{parent}.{side}"
    return found


PARENTS: Mapping[str, str] = _parents()
"""The parent of every role, parents first; the root's is empty."""
CHAINS = frozenset(["spine", "neck", *(f"{finger}.{side}" for finger in FINGERS for side in SIDES)])
"""Roles that several bones may play."""
REQUIRED = tuple(["hips", *(f"{limb}.{side}" for limb in ("thigh", "shin", "upper_arm", "forearm") for side in SIDES)])
"""Roles without which a skeleton is not human."""
LIMBS = {
    "trunk": ("hips", "spine", "neck", "head"),
    **{
        f"arm.{side}": tuple(f"{role}.{side}" for role in ("shoulder", "upper_arm", "forearm", "hand"))
        for side in SIDES
    },
    **{f"leg.{side}": tuple(f"{role}.{side}" for role in ("thigh", "shin", "foot", "toe")) for side in SIDES},
    **{f"fingers.{side}": tuple(f"{finger}.{side}" for finger in FINGERS) for side in SIDES},
}
"""Roles by limb, for reports."""


@dataclass(frozen=True)
class BoneMap:
    """Which bones of one rig play which roles.

    Attributes
    ----------
    bones : mapping of str to tuple of str
        Names of the bones by role: one each, or several for the roles in `CHAINS`; roles without a bone are absent.
    preset : str
        Name of the preset that the rig's controls follow; empty if there is none.
    found_by : str
        How the bones were found: "preset", "names", "places" or "file".
    """

    bones: Mapping[str, tuple[str, ...]]
    preset: str = ""
    found_by: str = "preset"

    def __post_init__(self) -> None:
        unknown = [role for role in self.bones if role not in PARENTS]
        if unknown:
            raise BodyError(f"'{unknown[0]}' is no role", where="bone map", todo=f"the roles are {', '.join(PARENTS)}")
        for role, names in self.bones.items():
            if not names or (len(names) > 1 and role not in CHAINS):
                raise BodyError(f"{len(names)} bones for '{role}'", where="bone map", todo="name one bone")

    def items(self) -> Iterator[tuple[str, int, str]]:
        """Generate role, index in its chain, and name of every bone, parents before children."""
        for role in PARENTS:
            for k, name in enumerate(self.bones.get(role, ())):
                yield role, k, name

    def names(self) -> list[str]:
        """Return the names of all bones, parents before children."""
        return [name for _, _, name in self.items()]

    def missing(self) -> list[str]:
        """Return the required roles that have no bone."""
        return [role for role in REQUIRED if role not in self.bones]

    def checked(self, names: Sequence[str], where: str) -> BoneMap:
        """Return the map if it is complete and valid for a rig with these bones.

        Raises
        ------
        BodyError
            A bone is missing or has two roles, or a required role has no bone; names it.
        """
        there, used = set(names), self.names()
        for role, _, name in self.items():
            if name not in there:
                raise BodyError(f"there is no bone '{name}' for '{role}'", where=where, todo="correct the bone map")
            if used.count(name) > 1:
                raise BodyError(f"bone '{name}' plays two roles", where=where, todo="correct the bone map")
        if self.missing():
            raise BodyError(
                f"no bone was found for {', '.join(self.missing())}",
                where=where,
                todo="choose another preset, or name the bones in a bone map: motion is sent to characters with two "
                "legs and two arms",
            )
        return self


def named_together(roles: Sequence[str]) -> str:
    """Return roles in words, fingers and both sides of a limb as one."""
    found: dict[str, None] = {}
    for role in roles:
        base, _, side = role.partition(".")
        both = all(f"{base}.{each}" in roles for each in SIDES)
        found["fingers" if base in FINGERS else base.replace("_", " ") if both or not side else role] = None
    return ", ".join(found)


def parent_role(role: str, there: Mapping[str, object]) -> str:
    """Return the nearest role above one, among those in `there`; empty if there is none."""
    above = PARENTS[role]
    while above and above not in there:
        above = PARENTS[above]
    return above
