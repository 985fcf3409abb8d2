"""Joints of limbs by position at rest: where legs and arms bend, whatever bones divide their segments."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations, pairwise

import numpy as np

from ...body.skeleton_motion import RestSkeleton
from ...numerics.arrays import Array
from .skeleton_tree import subtree

_AS_FAR = 0.1  # relative: bones of both sides are as far down their limbs within this
_STRAIGHT = float(np.cos(np.radians(30)))
"""Cosine of the largest angle between bones that may divide a segment of a limb."""
_UPPER_ARM = 0.172 / 0.150
"""Length of a human's upper arm in forearms, by `core.body.human`."""
_SHOULDERS_APART = 0.64
"""Distance between a human's shoulders, in lengths of upper arm and forearm together."""
_CLEARLY = 0.5
"""How much nearer to a human's proportions, as a difference of logarithms, an arm must be with divided segments."""
_LEAST_DIVIDED = 3
"""Number of bones above the hand of an arm with a collar bone, of which none is divided."""
_FINGERS = 3
"""Least number of bones that hang on a hand: the last bone of an arm with so many, as helpers may hang on a forearm."""
_LEG, _ARM = ("thigh", "shin", "foot", "toe"), ("upper_arm", "forearm", "hand")


def shared_bones(rest: RestSkeleton, top: int, other: int) -> list[int]:
    """Return a bone and those below it that are as far away from it, along the bones, as others are from another bone:
    both sides have them, however they are posed.
    """
    own, theirs = ({one: 0.0} for one in (top, other))
    for away in (own, theirs):
        for j in subtree(rest, next(iter(away)))[1:]:
            p = rest.parents[j]
            away[j] = away[p] + float(np.linalg.norm(rest.heads[j] - rest.heads[p]))
    others = np.array([*theirs.values()])
    return [j for j, way in own.items() if np.abs(others - way).min() <= _AS_FAR * way]


def leg_joints(rest: RestSkeleton, top: int, other: int, shortest: float) -> tuple[dict[str, int], Array]:
    """Return the bones of thigh, shin, foot and toes, and the lengths of thigh and shin, shape (2,); no bones if there
    are no such segments.

    Only what the limb on the other side has, too, counts.

    Parameters
    ----------
    top, other : int
        Bones with which this leg and that of the other side begin.
    shortest : float
        Least length of a segment.
    """
    shared = shared_bones(rest, top, other)
    path = _path(rest, top, shared[int(np.argmin(rest.heads[shared, 2]))])
    ways = _ways(rest, path)
    lengths = np.linalg.norm(ways, axis=1)
    long = np.flatnonzero(lengths > shortest)
    if len(long) < 2:
        return {}, np.zeros(2)
    upper, middle, end = long[0], long[0] + 1, long[1] + 1  # a knee may be divided in two
    first, last = _straight_run(ways, long[1])
    if last - first > 2:
        a, b, c = _segments(ways, range(first, last + 1), [*range(first, last + 1)], 1.0)
        if min(lengths[a:b].sum(), lengths[b:c].sum()) > shortest:  # small bones may follow the shin of a bent knee
            upper, middle, end = a, b, c
    found = dict(zip(_LEG, [path[upper], path[middle], *path[end:]], strict=False))
    return found, np.array([lengths[upper:middle].sum(), lengths[middle:end].sum()])


def arm_joints(rest: RestSkeleton, top: int, other: int, shortest: float) -> tuple[dict[str, int], Array]:
    """Return the bones of collar, upper arm, forearm and hand, and the lengths of upper arm and forearm, shape (2,); no
    bones if there are no such segments.

    Only what the limb on the other side has, too, counts: no weapon in a hand. Parameters as for `leg_joints`.
    """
    shared = shared_bones(rest, top, other)
    away = np.linalg.norm(rest.heads[shared] - rest.heads[top], axis=1)
    path = _path(rest, top, shared[int(np.argmax(away))])
    ways = _ways(rest, path)
    lengths = np.linalg.norm(ways, axis=1)
    palm = max((k for k, j in enumerate(path) if rest.parents.count(j) >= _FINGERS), default=0)
    apart = _apart(rest, path, other)
    if palm > _LEAST_DIVIDED:
        upper, middle, end = _segments(ways, range(palm + 1), [palm - 1, palm], _UPPER_ARM, apart)
        collar = path[0]
    else:
        long = np.flatnonzero(lengths > shortest)
        if len(long) < 2:
            return {}, np.zeros(2)
        # The longest two consecutive segments, below a long collar bone.
        upper, lower = max(pairwise(long), key=lambda two: float(lengths[two[0]] + lengths[two[1]]))
        middle, end = upper + 1, lower + 1
        last = len(path) - 1
        if last > _LEAST_DIVIDED:
            divided = _segments(ways, range(last + 1), range(last - 2, last + 1), _UPPER_ARM, apart)
            odd, odd_divided = (_unlike(lengths, at, _UPPER_ARM, apart) for at in ((upper, middle, end), divided))
            upper, middle, end = divided if odd_divided < odd - _CLEARLY else (upper, middle, end)
        collar = path[upper - 1]
    found = dict(zip(_ARM, [path[upper], path[middle], *path[end:]], strict=False))
    sizes = np.array([lengths[upper:middle].sum(), lengths[middle:end].sum()])
    if sizes.min() <= shortest:
        return {}, np.zeros(2)
    return found | ({"shoulder": collar} if upper > 0 else {}), sizes


def _path(rest: RestSkeleton, top: int, end: int) -> list[int]:
    path = [end]
    while path[-1] != top:
        path.append(rest.parents[path[-1]])
    return path[::-1]


def _ways(rest: RestSkeleton, path: Sequence[int]) -> Array:
    """Return the ways from joint to joint along a path of N bones, and to the last one's tail if it has one, (N, 3)."""
    points = np.concatenate([rest.heads[list(path)], rest.tails[[path[-1]]]])
    return np.nan_to_num(np.diff(points, axis=0))


def _go_on(ways: Array) -> Array:
    """Return whether each way but the last is followed by one in about its direction, (N - 1,)."""
    units = ways / np.maximum(np.linalg.norm(ways, axis=1, keepdims=True), 1e-12)
    return np.asarray(np.sum(units[:-1] * units[1:], axis=1) > _STRAIGHT)


def _straight_run(ways: Array, inside: int) -> tuple[int, int]:
    """Return the numbers of the first of the ways, and of the one after the last, that go on straight with one of
    them.
    """
    on = _go_on(ways)
    first = last = inside
    while first > 0 and on[first - 1]:
        first -= 1
    while last < len(on) and on[last]:
        last += 1
    return first, last + 1


def _apart(rest: RestSkeleton, path: Sequence[int], other: int) -> Array:
    """Return how far the N bones of a limb are across the body from the same bones of the limb on the other side, (N,);
    `other` is the first bone of that limb.
    """
    far = max(subtree(rest, other), key=lambda j: float(np.linalg.norm(rest.heads[j] - rest.heads[other])))
    across = rest.heads[path[-1]] - rest.heads[far]
    across = across / max(float(np.linalg.norm(across)), 1e-12)
    return np.asarray(2 * (rest.heads[list(path)] - (rest.heads[path[0]] + rest.heads[other]) / 2) @ across)


def _segments(
    ways: Array, joints: Sequence[int], ends: Sequence[int], ratio: float, apart: Array | None = None
) -> tuple[int, int, int]:
    """Return where two straight segments of a limb begin and end, of those that the ways from joint to joint make up:
    the ratio of their lengths is most nearly the given one, they leave little of the limb out, and if `apart` is given,
    (N,) as by `_apart`, they begin as far apart as a human's arms.
    """
    lengths, on = np.linalg.norm(ways, axis=1), _go_on(ways)
    whole = max(float(lengths[joints[0] : joints[-1]].sum()), 1e-12)

    def unlike(found: tuple[int, int, int]) -> float:
        a, b, c = found
        bent = not (on[a : b - 1].all() and on[b : c - 1].all() and c in ends)
        return (
            _unlike(lengths, found, ratio, apart)
            + float(np.log(whole / sum(_two_lengths(lengths, found))))
            + 1e3 * bent
        )

    return min(combinations(joints, 3), key=unlike)


def _two_lengths(lengths: Array, joints: tuple[int, int, int]) -> tuple[float, float]:
    """Return the lengths of the two segments between three joints of a limb, metres, a little above 0 at least, from
    those of the ways from joint to joint, (N,).
    """
    a, b, c = joints
    least = 1e-9 * max(float(lengths.sum()), 1e-3)
    return max(float(lengths[a:b].sum()), least), max(float(lengths[b:c].sum()), least)


def _unlike(lengths: Array, joints: tuple[int, int, int], ratio: float, apart: Array | None) -> float:
    """Return how unlike a human's the two segments between three joints are, as a sum of logarithms: of the ratio of
    their lengths by the given one, and, if `apart` is given, of the distance between the shoulders by a human's.
    """
    upper, lower = _two_lengths(lengths, joints)
    shoulders = 1.0 if apart is None else max(float(apart[joints[0]]) / (upper + lower) / _SHOULDERS_APART, 1e-3)
    return float(abs(np.log(upper / lower / ratio)) + abs(np.log(shoulders)))
