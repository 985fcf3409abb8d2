"""Roles of bones by position at rest: legs reach lowest, arms are most like a human's, and the head is on top."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from itertools import product

import numpy as np
from scipy.spatial import cKDTree

from ...body.skeleton_motion import RestSkeleton
from ...numerics.arrays import Array
from .bone_words import read_name
from .limb_joints import arm_joints, leg_joints, shared_bones
from .roles import FINGERS
from .skeleton_tree import SkeletonTree, subtree

_SYMMETRY = 0.03  # of the height: largest distance of a bone's partner from its mirror image
_MIN_LENGTH = 0.08  # of the height of a human with such shoulders: least length of a segment of an arm or leg
_SHOULDERS = 0.818  # of the height of a human: that of its shoulders
_AS_LOW = 0.05  # of the height: legs that reach as low as others within this may be a human's
_ARM = (0.172 / 0.245, 0.150 / 0.246, 0.288 / 0.491)
"""A human's upper arm in thighs, forearm in shins, and height of the shoulders above the hips in legs, by the segment
lengths in `core.body.human`.
"""
_FINGERS = 3
"""Least number of fingers that show a hand, without the thumb."""
_BESIDE = 0.7
"""Shoulders that are further beside the hips than above them, by more than this in legs, are of a body that lies."""
_IN_PALM = 0.5
"""A bone that begins nearer to the wrist than this share of where the next one does is no part of a finger."""
_SAME_CARRIER = 2.0
"""How far limbs that hang on the same bone as the legs differ from arms, as the logarithm of a proportion."""
_LEVEL = 10.0  # least horizontal distance of siblings on both sides, in units of the vertical one
_HALF_TURN = 36
"""Directions of siblings are told apart in so many steps of a half turn."""
_TRUNK = 8
"""Bones with several children, of those with most bones below them, that may be in the middle."""

_Pair = tuple[int, int]


def roles_by_position(rest: RestSkeleton) -> dict[str, tuple[str, ...]]:
    """Return bones by role for an upright, symmetrical skeleton; empty if it is not human.

    Left and right are as the names of the limbs say, else as the feet point.
    """
    points = np.where(np.isnan(rest.tails), rest.heads, rest.tails)
    height = float(max(rest.heads[:, 2].max(), points[:, 2].max()) - min(rest.heads[:, 2].min(), points[:, 2].min()))
    if height <= 0:
        return {}
    lateral, aside = _mirror(rest, _SYMMETRY * height)
    pairs = _mirrored_branches(rest, lateral, aside, _SYMMETRY * height)
    limbs = _legs_and_arms(rest, pairs, _AS_LOW * height)
    if limbs is None:
        return {}
    found: dict[str, tuple[str, ...]] = {}
    left = _left(rest, limbs, lateral)
    sides = [_joints(rest, *limbs), _joints(rest, limbs[0][::-1], limbs[1][::-1])]
    for pair in ([limb for limb, _ in pair] for pair in zip(*sides, strict=True)):
        for limb, other in (pair, pair[::-1]):
            first = next(iter(limb))  # the branches themselves may begin in the middle
            side = "L" if float(left @ (rest.heads[limb[first]] - rest.heads[other[first]])) > 0 else "R"
            found |= {f"{role}.{side}": (rest.names[j],) for role, j in limb.items()}
            fingers = _fingers(rest, limb["hand"]) if "hand" in limb else {}
            found |= {f"{role}.{side}": tuple(rest.names[j] for j in bones) for role, bones in fingers.items()}
    found |= _trunk(rest, limbs[0][0], limbs[1])
    return found


def _mirror(rest: RestSkeleton, near: float) -> tuple[Array, Array]:
    """Return the horizontal axis along which the skeleton is symmetrical, as a unit vector, and how far each bone is
    from the middle, shape (J,): of the planes through bones with several children, the one across which most bones have
    a partner.
    """
    tree, children = cKDTree(rest.heads), Counter(rest.parents)
    forks = [j for j in range(len(rest.names)) if children[j] > 1]
    forks = sorted(forks, key=lambda j: -len(subtree(rest, j)))[:_TRUNK]
    best = (0.0, np.eye(3)[0], np.zeros(len(rest.names)))
    for axis in _across(rest, forks):
        along = rest.heads @ axis
        for middle in np.unique(np.round(along[forks] / near, 1)) * near:
            aside = along - middle
            apart, _ = tree.query(rest.heads - 2 * np.outer(aside, axis), distance_upper_bound=near)
            partners = np.isfinite(apart) & (np.abs(aside) > near)
            score = float(np.sum(1 - apart[partners] / (2 * near)))
            if score > best[0]:
                best = (score, axis, aside)
    return best[1], best[2]


def _across(rest: RestSkeleton, forks: Sequence[int]) -> list[Array]:
    """Return horizontal axes along which a skeleton may be symmetrical: those of the world, and between siblings."""
    found = {0: np.array([1.0, 0.0, 0.0]), _HALF_TURN // 2: np.array([0.0, 1.0, 0.0])}
    for fork in forks:
        at = rest.heads[[j for j, p in enumerate(rest.parents) if p == fork]]
        ways = np.concatenate([at[k + 1 :] - at[k] for k in range(len(at))])
        ways = ways[np.linalg.norm(ways[:, :2], axis=1) > _LEVEL * np.abs(ways[:, 2])]
        turns = np.arctan2(ways[:, 1], ways[:, 0]) / np.pi * _HALF_TURN
        for step, turn in zip(np.round(turns).astype(int) % _HALF_TURN, turns * np.pi / _HALF_TURN, strict=True):
            found.setdefault(int(step), np.array([np.cos(turn), np.sin(turn), 0.0]))
    return [*found.values()]


def _mirrored_branches(rest: RestSkeleton, lateral: Array, aside: Array, near: float) -> list[_Pair]:
    """Return pairs of children of a bone in the middle that are mirror images of each other, and below which most bones
    are as long as others on the other side, however these limbs are posed.
    """
    images = rest.heads - 2 * aside[:, None] * lateral
    below = [subtree(rest, j) for j in range(len(rest.names))]
    pairs: list[_Pair] = []
    for j, p in enumerate(rest.parents):
        if p < 0 or abs(aside[p]) >= near / 2 or max(abs(aside[below[j]])) < near:
            continue
        apart = np.linalg.norm(rest.heads - images[j], axis=1)
        for k in (k for k in np.flatnonzero(apart < near) if rest.parents[k] == p and k != j):
            opposite = float(aside[below[j]].mean() * aside[below[k]].mean()) < 0
            shared = len(shared_bones(rest, j, k)) if opposite else 0
            if shared > max(1, len(below[j]) / 2):
                pairs.append((j, int(k)))
                break
    return pairs


def _legs_and_arms(rest: RestSkeleton, pairs: Sequence[_Pair], as_low: float) -> tuple[_Pair, _Pair] | None:
    """Return the pairs of limbs that are most like the legs and arms of a human, of those that reach lowest and those
    above them; None if there are none.
    """
    lows = {pair: min(rest.heads[j, 2] for j in subtree(rest, pair[0])) for pair in pairs}
    best: tuple[float, _Pair, _Pair] | None = None
    for legs, arms in product(pairs, pairs):
        reach = lows[legs] <= min(lows.values()) + as_low
        if reach and rest.heads[list(arms), 2].min() > rest.heads[list(legs), 2].max():
            unlike = max(_unlike_human(rest, legs, arms), _unlike_human(rest, legs[::-1], arms[::-1]))
            if np.isfinite(unlike) and (best is None or unlike < best[0]):
                best = (unlike, legs, arms)
    return None if best is None else best[1:]


def _joints(rest: RestSkeleton, legs: _Pair, arms: _Pair) -> list[tuple[dict[str, int], Array]]:
    """Return the bones of the first leg and the first arm, and the lengths of their segments; see `leg_joints`."""
    shoulders = float(rest.heads[list(arms), 2].mean() - rest.heads[:, 2].min())  # a head or a hat may be huge
    shortest = _MIN_LENGTH / _SHOULDERS * shoulders
    return [leg_joints(rest, *legs, shortest), arm_joints(rest, *arms, shortest)]


def _unlike_human(rest: RestSkeleton, legs: _Pair, arms: _Pair) -> float:
    """Return how far limbs differ from the legs and arms of a human, in proportions and in their places, as wings,
    hair, skirts and the hind legs of a centaur do; infinite if they are no limbs, or those of four legs.
    """
    (leg, of_leg), (arm, of_arm) = _joints(rest, legs, arms)
    if not leg or not arm:
        return float(np.inf)
    whole = float(of_leg.sum())
    rise = float(rest.heads[arm["upper_arm"], 2] - rest.heads[leg["thigh"], 2]) / whole
    beside = float(np.linalg.norm((_middle(rest, arms) - _middle(rest, legs))[:2])) / whole
    if beside > max(rise, _BESIDE):
        return float(np.inf)
    ratios = np.array([*(of_arm / of_leg), max(rise, 0.1)]) / _ARM
    hand = subtree(rest, arm["hand"]) if "hand" in arm else []
    tips = [j for j in hand[1:] if j not in rest.parents]
    same = rest.parents[arms[0]] == rest.parents[legs[0]]  # a skirt hangs on the hips as the legs do
    return float(np.abs(np.log(ratios)).sum()) + beside + _SAME_CARRIER * same - (len(tips) >= _FINGERS)


def _middle(rest: RestSkeleton, pair: tuple[int, int]) -> Array:
    return np.asarray(rest.heads[list(pair)].mean(axis=0))


def _left(rest: RestSkeleton, pairs: Sequence[tuple[int, int]], lateral: Array) -> Array:
    """Return the direction of the left side, given pairs of limbs, that of the legs first; unit vector."""
    marked = 0.0
    for pair in pairs:
        for one in pair:
            aside = float((rest.heads[one] - _middle(rest, pair)) @ lateral)
            sides = [read_name(rest.names[j]).side for j in subtree(rest, one)]
            marked += np.sign(aside) * (sides.count("L") - sides.count("R"))
    if marked:
        return np.asarray(np.sign(marked) * lateral)
    return np.asarray(np.cross([0.0, 0.0, 1.0], _forward(rest, pairs[0], lateral)))


def _forward(rest: RestSkeleton, legs: tuple[int, int], lateral: Array) -> Array:
    """Return the horizontal direction of the feet, each from the lowest third of its shin to the farthest point below,
    as the feet may be a step apart.
    """
    ahead = np.cross(lateral, [0.0, 0.0, 1.0])
    reach = []
    for leg in legs:
        below = subtree(rest, leg)
        low, top = (limit(rest.heads[j, 2] for j in below) for limit in (min, max))
        feet = [j for j in below if rest.heads[j, 2] < low + 0.2 * (top - low)]
        points = np.concatenate([rest.heads[feet], rest.tails[feet][~np.isnan(rest.tails[feet][:, 0])]])
        reach.append((points - rest.heads[feet[0]]) @ ahead)
    ways = np.concatenate(reach)
    return np.asarray(ahead if abs(ways.max()) >= abs(ways.min()) else -ahead)


def _fingers(rest: RestSkeleton, hand: int) -> dict[str, list[int]]:
    """Return the fingers of a hand with four or five of them: the thumb points most apart, and others follow by how far
    they are from it. Bones in the palm are left out.
    """
    children = {j: [k for k, p in enumerate(rest.parents) if p == j] for j in subtree(rest, hand)}
    palm = hand
    while len(children[palm]) == 1:
        palm = children[palm][0]
    chains = [[top] for top in children[palm]]
    for chain in chains:
        while children[chain[-1]]:
            chain.append(max(children[chain[-1]], key=lambda j: len(subtree(rest, j))))
    chains = [chain for chain in chains if len(chain) > 1]
    if len(chains) not in (_FINGERS + 1, _FINGERS + 2):
        return {}
    ways = np.array([rest.heads[chain[-1]] - rest.heads[chain[0]] for chain in chains])
    ways /= np.maximum(np.linalg.norm(ways, axis=1, keepdims=True), 1e-12)
    thumb = chains.pop(int(np.argmin(ways @ ways.sum(axis=0))))
    for chain in chains:
        away = np.linalg.norm(rest.heads[chain[:2]] - rest.heads[hand], axis=1)
        if len(chain) > 3 and away[0] < _IN_PALM * away[1]:
            del chain[0]
    chains.sort(key=lambda chain: float(np.linalg.norm(rest.heads[chain[0]] - rest.heads[thumb[0]])))
    names = FINGERS if len(chains) > _FINGERS else [finger for finger in FINGERS if finger != "ring"]
    return {finger: chain[:3] for finger, chain in zip(names, [thumb, *chains], strict=True)}


def _trunk(rest: RestSkeleton, leg: int, arms: _Pair) -> dict[str, tuple[str, ...]]:
    """Return hips, spine, neck and head: the path from the legs' parent to the arms' parent, and on to the top."""
    tree = SkeletonTree(rest)
    hips, chest = tree.common([leg, arms[0]]), rest.parents[arms[0]]
    if hips < 0:
        return {}
    way = [chest, *tree.above(chest)]
    spine = way[: way.index(hips)]
    found: dict[str, tuple[str, ...]] = {"hips": (rest.names[hips],)}
    if spine:
        found["spine"] = tuple(rest.names[k] for k in reversed(spine))
    above = [k for k in range(len(rest.names)) if rest.parents[k] == chest and rest.heads[k, 2] >= rest.heads[chest, 2]]
    above = [k for k in above if k not in arms and _rises(rest, chest, k)]
    if not above:
        return found
    neck = [max(above, key=lambda k: max(rest.heads[i, 2] for i in subtree(rest, k)))]
    while below := [k for k in range(len(rest.names)) if rest.parents[k] == neck[-1]]:
        straight = [k for k in below if len([i for i in below if abs(rest.heads[i, 2] - rest.heads[k, 2]) < 1e-6]) == 1]
        if len(below) > 1 or not straight or not _rises(rest, neck[-1], below[0]):
            break
        neck.append(below[0])
    last = read_name(rest.names[neck[-1]])
    without_tail = np.isnan(rest.tails[neck[-1], 2]) and last.part != "head"
    if len(neck) > 1 and (without_tail or last.kind == "helper"):
        neck.pop()  # a joint that only marks the end of the head
    found["head"] = (rest.names[neck[-1]],)
    if len(neck) > 1:
        found["neck"] = tuple(rest.names[k] for k in neck[:-1])
    return found


def _rises(rest: RestSkeleton, low: int, high: int) -> bool:
    """Whether a bone begins rather above another one than before, behind or beside it, as no jaw or plait does."""
    way = rest.heads[high] - rest.heads[low]
    return bool(np.abs(way[:2]).max() < abs(way[2]) + 1e-3)
