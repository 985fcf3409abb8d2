"""Roles of bones by position at rest: legs reach lowest, arms farthest to the sides, and the head is on top."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from ..body.skeleton_motion import RestSkeleton
from ..numerics.arrays import Array
from .bone_words import read_name
from .skeleton_tree import SkeletonTree

_SYMMETRY = 0.03  # of the height: largest distance of a bone's partner from its mirror image
_MIN_LENGTH = 0.08  # of the height: least length of a thigh, shin, upper arm or forearm


def roles_by_place(rest: RestSkeleton) -> dict[str, tuple[str, ...]]:
    """Return bones by role for an upright, symmetrical skeleton; empty if it is not human.

    Left and right are as the names of the limbs say, else as the feet point.
    """
    points = np.where(np.isnan(rest.tails), rest.heads, rest.tails)
    height = float(max(rest.heads[:, 2].max(), points[:, 2].max()) - min(rest.heads[:, 2].min(), points[:, 2].min()))
    if height <= 0:
        return {}
    lateral = _lateral_axis(rest)
    pairs = _mirrored_branches(rest, lateral, _SYMMETRY * height)
    if len(pairs) < 2:
        return {}
    paths = {pair: _farthest_path(rest, pair[0], lateral) for pair in pairs}
    legs = min(pairs, key=lambda pair: min(rest.heads[j, 2] for j in _subtree(rest, pair[0])))
    higher = [pair for pair in pairs if rest.heads[list(pair), 2].min() > rest.heads[list(legs), 2].max()]
    if not higher:
        return {}
    # A skirt may be longer than the arms, but hangs on the hips as the legs do.
    apart = [pair for pair in higher if rest.parents[pair[0]] != rest.parents[legs[0]]]
    arms = max(apart or higher, key=lambda pair: _length(rest, paths[pair]))
    found: dict[str, tuple[str, ...]] = {}
    left = _left(rest, (legs, arms), lateral)
    for branch in (legs, arms):
        for one in branch:
            on_left = float(left @ (rest.heads[one] - _middle(rest, branch))) > 0
            limb = _limb_roles(rest, one, branch == arms, lateral, _MIN_LENGTH * height)
            found |= {f"{role}.{'L' if on_left else 'R'}": (rest.names[j],) for role, j in limb.items()}
    found |= _trunk(rest, legs[0], arms[0])
    return found


def _lateral_axis(rest: RestSkeleton) -> Array:
    """Return the horizontal axis (x or y) along which the skeleton is symmetrical, as a unit vector."""
    scores = []
    for axis in np.eye(3)[:2]:
        aside = (rest.heads - _centre(rest)) @ axis
        mirrored = rest.heads - 2 * np.outer(aside, axis)
        error = np.linalg.norm(mirrored[:, None] - rest.heads[None], axis=2).min(axis=1).mean()
        scores.append(np.abs(aside).mean() - 3 * error)
    return np.asarray(np.eye(3)[int(np.argmax(scores))])


def _centre(rest: RestSkeleton) -> Array:
    return np.asarray((rest.heads.min(axis=0) + rest.heads.max(axis=0)) / 2)


def _mirrored_branches(rest: RestSkeleton, lateral: Array, near: float) -> list[tuple[int, int]]:
    """Return pairs of bones that are mirror images of each other and children of a bone in the middle."""
    aside = (rest.heads - _centre(rest)) @ lateral
    ends = [max(_subtree(rest, j), key=lambda k: abs(aside[k])) for j in range(len(rest.names))]
    central = [abs(aside[j]) < near / 2 for j in range(len(rest.names))]
    pairs = []
    for j, p in enumerate(rest.parents):
        if p < 0 or aside[ends[j]] < near:
            continue
        for k in range(len(rest.names)):
            if rest.parents[k] != p or k == j:
                continue
            images = [rest.heads[i] - 2 * aside[i] * lateral for i in (j, ends[j])]
            apart = [np.linalg.norm(image - rest.heads[i]) for image, i in zip(images, (k, ends[k]), strict=True)]
            if max(apart) < near and central[p]:
                pairs.append((j, k))
                break
    return pairs


def _subtree(rest: RestSkeleton, top: int) -> list[int]:
    found = [top]
    for j in range(top + 1, len(rest.names)):
        if rest.parents[j] in found:
            found.append(j)
    return found


def _farthest_path(rest: RestSkeleton, top: int, lateral: Array) -> list[int]:
    """Return the bones from one to the descendant whose joint is farthest away."""
    end = max(_subtree(rest, top), key=lambda k: float(np.linalg.norm(rest.heads[k] - rest.heads[top])))
    path = [end]
    while path[-1] != top:
        path.append(rest.parents[path[-1]])
    return path[::-1]


def _length(rest: RestSkeleton, path: Sequence[int]) -> float:
    return float(np.linalg.norm(np.diff(rest.heads[list(path)], axis=0), axis=1).sum())


def _middle(rest: RestSkeleton, pair: tuple[int, int]) -> Array:
    return np.asarray(rest.heads[list(pair)].mean(axis=0))


def _left(rest: RestSkeleton, pairs: Sequence[tuple[int, int]], lateral: Array) -> Array:
    """Return the direction of the left side, given pairs of limbs, that of the legs first; unit vector."""
    marked = 0.0
    for pair in pairs:
        for one in pair:
            aside = float((rest.heads[one] - _middle(rest, pair)) @ lateral)
            sides = [read_name(rest.names[j]).side for j in _subtree(rest, one)]
            marked += np.sign(aside) * (sides.count("L") - sides.count("R"))
    if marked:
        return np.asarray(np.sign(marked) * lateral)
    return np.asarray(np.cross([0.0, 0.0, 1.0], _forward(rest, pairs[0], lateral)))


def _forward(rest: RestSkeleton, legs: tuple[int, int], lateral: Array) -> Array:
    """Return the horizontal direction of the feet, from the lowest third of the shins to the farthest point below."""
    below = [j for leg in legs for j in _subtree(rest, leg)]
    low = min(rest.heads[j, 2] for j in below)
    top = max(rest.heads[j, 2] for j in below)
    ahead = np.cross(lateral, [0.0, 0.0, 1.0])
    feet = [j for j in below if rest.heads[j, 2] < low + 0.2 * (top - low)]
    points = np.concatenate([rest.heads[feet], rest.tails[feet][~np.isnan(rest.tails[feet][:, 0])]])
    reach = (points - rest.heads[feet[0]]) @ ahead
    return np.asarray(ahead if abs(reach.max()) >= abs(reach.min()) else -ahead)


def _limb_roles(rest: RestSkeleton, top: int, arm: bool, lateral: Array, shortest: float) -> dict[str, int]:
    """Return the bones of an arm or leg: its two long segments, the bone above the first, and those below the
    second.
    """
    path = _farthest_path(rest, top, lateral)
    if not arm:
        low = min(_subtree(rest, top), key=lambda j: float(rest.heads[j, 2]))
        path = [low]
        while path[-1] != top:
            path.append(rest.parents[path[-1]])
        path = path[::-1]
    ends = [*path, -1]
    lengths = [
        float(np.linalg.norm((rest.heads[b] if b >= 0 else rest.tails[a]) - rest.heads[a])) for a, b in pairwise(ends)
    ]
    long = [k for k, length in enumerate(lengths) if length > shortest]
    if len(long) < 2:
        return {}
    upper, lower = long[:2] if not arm else _arm_segments(long, lengths)
    names = ("shoulder", "upper_arm", "forearm", "hand", "") if arm else ("", "thigh", "shin", "foot", "toe")
    found = {names[1]: path[upper], names[2]: path[lower]}
    if upper > 0 and names[0]:
        found[names[0]] = path[upper - 1]
    for k, name in enumerate(names[3:]):
        if lower + 1 + k < len(path) and name:
            found[name] = path[lower + 1 + k]
    return found


def _arm_segments(long: list[int], lengths: Sequence[float]) -> tuple[int, int]:
    """Return upper arm and forearm: the longest two consecutive segments."""
    pairs = list(pairwise(long))
    return max(pairs, key=lambda pair: lengths[pair[0]] + lengths[pair[1]])


def _trunk(rest: RestSkeleton, leg: int, arm: int) -> dict[str, tuple[str, ...]]:
    """Return hips, spine, neck and head: the path from the legs' parent to the arms' parent, and on to the top."""
    tree = SkeletonTree(rest)
    hips, chest = tree.common([leg, arm]), rest.parents[arm]
    if hips < 0:
        return {}
    way = [chest, *tree.above(chest)]
    spine = way[: way.index(hips)]
    found: dict[str, tuple[str, ...]] = {"hips": (rest.names[hips],)}
    if spine:
        found["spine"] = tuple(rest.names[k] for k in reversed(spine))
    above = [k for k in range(len(rest.names)) if rest.parents[k] == chest and rest.heads[k, 2] >= rest.heads[chest, 2]]
    above = [
        k
        for k in above
        if abs(rest.heads[k] - rest.heads[chest])[:2].max() < abs(rest.heads[k, 2] - rest.heads[chest, 2]) + 1e-3
    ]
    if not above:
        return found
    neck = [max(above, key=lambda k: max(rest.heads[i, 2] for i in _subtree(rest, k)))]
    while below := [k for k in range(len(rest.names)) if rest.parents[k] == neck[-1]]:
        straight = [k for k in below if len([i for i in below if abs(rest.heads[i, 2] - rest.heads[k, 2]) < 1e-6]) == 1]
        if len(below) > 1 or not straight:
            break
        neck.append(below[0])
    last = neck[-1]
    if len(neck) > 1 and (np.isnan(rest.tails[last, 2]) or read_name(rest.names[last]).kind == "helper"):
        neck.pop()  # a joint that only marks the end of the head
    found["head"] = (rest.names[neck[-1]],)
    if len(neck) > 1:
        found["neck"] = tuple(rest.names[k] for k in neck[:-1])
    return found
