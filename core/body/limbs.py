"""The limbs of a body: arms and legs as chains of its parts, and which are each other's left and right."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..numerics.arrays import Ints
from .body import Body

MAIN_JOINTS = ("Shoulder", "Elbow", "Wrist", "Hip", "Knee", "Ankle")
"""The joints of arms and legs, which nearly every detector finds: names of landmarks without "L" or "R"."""


def limbs(body: Body) -> list[list[int]]:
    """Chains of at least two parts from the last branching of the tree to its tips, as indices, the tip last.

    Collar bones do not belong to them: they would waste poses that are sampled for an arm on rotations that hardly move
    it.
    """
    children = np.bincount([p for p in body.parents if p >= 0], minlength=len(body))
    chains = []
    for tip in np.flatnonzero(children == 0):
        chain = [int(tip)]
        while (parent := body.parents[chain[0]]) > 0 and children[parent] == 1 and not body.is_stiff[parent]:
            chain.insert(0, parent)
        if len(chain) > 1:
            chains.append(chain)
    return chains


def numbered_limbs(bodies: Sequence[Body]) -> Ints:
    """Return a number for every part of some bodies, shape (P,): the same for all parts of a limb, and of a trunk."""
    numbers, first, count = np.zeros(sum(len(body) for body in bodies), np.int64), 0, 0
    for body in bodies:
        own = numbers[first : first + len(body)]
        for number, chain in enumerate(([*range(len(body))], *limbs(body)), count):
            own[chain] = number
        first, count = first + len(body), count + 1 + len(limbs(body))
    return numbers


def without_end(chain: Sequence[int]) -> list[int]:
    """Return the parts of a limb without the last of three: the rotation of a hand or a foot is hardly visible."""
    return list(chain[: max(2, len(chain) - 1)])


def limb_pairs(body: Body) -> list[tuple[list[int], list[int]]]:
    """Pairs of a left limb and the right one that looks like it, by Blender's names."""
    chains = {tuple(body.names[part] for part in chain): chain for chain in limbs(body)}
    sides = [(names, tuple(name.removesuffix(".L") + ".R" for name in names)) for names in chains]
    return [(chains[left], chains[right]) for left, right in sides if left != right and right in chains]
