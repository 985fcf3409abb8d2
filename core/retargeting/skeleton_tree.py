"""What hangs on what in a skeleton, and the trunk between limbs that are known."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from ..body.skeleton_motion import RestSkeleton
from .roles import SIDES


class SkeletonTree:
    """The bones of a skeleton by their places, parents first."""

    def __init__(self, rest: RestSkeleton) -> None:
        self._heads = rest.heads
        self._above: list[list[int]] = []
        for parent in rest.parents:
            self._above.append([] if parent < 0 else [parent, *self._above[parent]])

    def above(self, j: int) -> list[int]:
        """What a bone hangs on, its parent first."""
        return self._above[j]

    def is_above(self, upper: int, lower: int) -> bool:
        """Whether a bone hangs on another one."""
        return upper in self._above[lower]

    def chain(self, bones: Sequence[int], most: int) -> list[int]:
        """The first of some bones, and those that hang on each other below it, at most so many."""
        found = list(bones[:1])
        for j in bones[1:]:
            if len(found) < most and self.is_above(found[-1], j):
                found.append(j)
        return found

    def common(self, bones: Iterable[int]) -> int:
        """The lowest bone that all of some bones hang on, -1 for none."""
        ways = [self._above[j] for j in bones]
        return next((j for j in ways[0] if all(j in way for way in ways)), -1) if ways else -1

    def with_trunk(self, found: Mapping[str, Sequence[int]]) -> dict[str, list[int]]:
        """Return roles with hips that carry legs and arms, and the spine and the neck between, where limbs are known.

        Names do not tell: thighs and spine may hang side by side on a bone above that which is called pelvis, and
        chains have bones of other names.
        """
        roles = {role: list(bones) for role, bones in found.items()}
        legs, arms = ([roles[f"{limb}.{s}"][0] for s in SIDES if f"{limb}.{s}" in roles] for limb in _TOPS)
        if len(legs) < 2 or len(arms) < 2:
            return roles
        carrier, chest = self.common([*legs, *arms]), self.common(arms)
        named = roles.get("hips", [-1])[0]
        if carrier < 0:
            return roles
        if not all(self.is_above(named, j) for j in (*legs, *arms)):
            roles["hips"] = [carrier]
            if roles.get("root") == [carrier]:
                del roles["root"]
        hips = roles["hips"][0]
        roles["spine"] = self._between(hips, [chest, *self._above[chest]], roles, "spine")
        if "head" in roles:
            last = (roles["spine"] or [hips])[-1]
            head = roles["head"][0]
            apart = [j for j in self._above[head] if not np.allclose(self._heads[j], self._heads[head])]
            roles["neck"] = self._between(last, apart, roles, "neck")
        return {role: bones for role, bones in roles.items() if bones}

    def _between(self, top: int, way: Sequence[int], roles: Mapping[str, Sequence[int]], role: str) -> list[int]:
        """Bones on a way upwards below a bone, from there outwards: those that are named, else all without a role."""
        if top not in way:
            return [j for j in roles.get(role, []) if j != top]
        path = list(way[: way.index(top)])[::-1]
        others = {j for other, bones in roles.items() if other != role for j in bones}
        free = [j for j in path if j not in others]
        named = [j for j in free if j in roles.get(role, [])]
        return named or free


_TOPS = ("thigh", "upper_arm")
