"""The hierarchy of a skeleton, and its trunk between known limbs."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from ...body.skeleton_motion import RestSkeleton
from .roles import SIDES

_TOPS = ("thigh", "upper_arm")
"""Roles of the uppermost bones of the limbs."""
_SEGMENTS = ("thigh", "shin", "upper_arm", "forearm")
"""Roles of the bones of limbs."""


def subtree(rest: RestSkeleton, top: int) -> list[int]:
    """Return a bone and all bones below it."""
    found = {top: None}
    for j in range(top + 1, len(rest.names)):
        if rest.parents[j] in found:
            found[j] = None
    return [*found]


class SkeletonTree:
    """The hierarchy of a skeleton; bones are given by their indices, parents first."""

    def __init__(self, rest: RestSkeleton) -> None:
        self._heads = rest.heads
        self._above: list[list[int]] = []
        for parent in rest.parents:
            self._above.append([] if parent < 0 else [parent, *self._above[parent]])

    def above(self, j: int) -> list[int]:
        """Return the ancestors of a bone, its parent first."""
        return self._above[j]

    def is_above(self, upper: int, lower: int) -> bool:
        """Whether `upper` is an ancestor of `lower`."""
        return upper in self._above[lower]

    def chain(self, bones: Sequence[int], most: int) -> list[int]:
        """Return the first of some bones and those that continue it downward, each a descendant of the one before, at
        most `most` of them; of several such chains the longest.
        """
        chains = [[k for k in bones if k == j or self.is_above(k, j)] for j in bones]
        return max((chain for chain in chains if chain[0] == bones[0]), key=len, default=[])[:most]

    def carrying(self, bones: Iterable[int], below: Iterable[int]) -> list[int]:
        """Return those of some bones on which any of others hangs."""
        lower = list(below)
        return [j for j in bones if any(self.is_above(j, k) for k in lower)]

    def common(self, bones: Iterable[int]) -> int:
        """Return the lowest common ancestor of some bones, -1 if there is none."""
        ways = [self._above[j] for j in bones]
        return next((j for j in ways[0] if all(j in way for way in ways)), -1) if ways else -1

    def says_nothing(self, found: Mapping[str, Sequence[int]]) -> bool:
        """Whether all segments of the limbs hang side by side on one bone: parents tell nothing then."""
        limbs = [found[role][0] for limb in _SEGMENTS for s in SIDES if (role := f"{limb}.{s}") in found]
        return len(limbs) > 1 and len({tuple(self._above[j][:1]) for j in limbs}) == 1

    def with_trunk(self, found: Mapping[str, Sequence[int]]) -> dict[str, list[int]]:
        """Return roles with hips, spine and neck added by position between the known limbs.

        Names are unreliable here: thighs and spine may be siblings under a bone above the one called pelvis, and chains
        contain bones with other names. Where the hierarchy says nothing, they count all the same.
        """
        roles = {role: list(bones) for role, bones in found.items()}
        legs, arms = ([roles[f"{limb}.{s}"][0] for s in SIDES if f"{limb}.{s}" in roles] for limb in _TOPS)
        if len(legs) < 2 or len(arms) < 2:
            return roles
        carrier, chest = self.common([*legs, *arms]), self.common(arms)
        named = roles.get("hips", [-1])[0]
        if carrier < 0 or ("hips" in roles and self.says_nothing(roles)):
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
        """Return the bones of a path below `top`, outward: those named for a role, or else all without a role."""
        if top not in way:
            return [j for j in roles.get(role, []) if j != top]
        path = list(way[: way.index(top)])[::-1]
        others = {j for other, bones in roles.items() if other != role for j in bones}
        free = [j for j in path if j not in others]
        named = [j for j in free if j in roles.get(role, [])]
        return named or free
