"""Aligning the rest pose of one skeleton with that of another: A pose to T pose, facing, feet, palms.

The orientation of a target bone on every frame is D A R0, where R0 is its rest orientation, A rotates its rest pose to
that of the source's bone, and D is the rotation of the source's bone from its rest pose. The bones' own axes (roll)
cancel out. Aligning a skeleton to another and back gives inverse rotations.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

import numpy as np
from scipy.spatial.transform import Rotation

from ...body.skeleton_motion import RestSkeleton
from ...errors import BodyError
from ...numerics.arrays import Array
from ..bone_roles.roles import FINGERS, PARENTS, SIDES, BoneMap, parent_role
from .palms import palm_along, palm_axes

_Skeleton = tuple[RestSkeleton, BoneMap]
_UP = np.array([0.0, 0.0, 1.0])
_NEXT = {"upper_arm": "forearm", "forearm": "hand", "thigh": "shin", "shin": "foot", "foot": "toe"}
_MIN_TOE_LENGTH, _USUAL_TOE_LENGTH = 0.2, 0.5
"""Least length of toes that is not arbitrary, and usual length, in units of the distance from ankle to ball."""
_LEAST_FOOT = 0.12  # of the distance from ankle to knee: the tail of a foot's bone that is nearer is arbitrary
_TO_TIPS = 0.35
"""Horizontal length of a foot's bone, in units of the distance from ankle to knee, from which on it is taken to end at
the tips of the toes: that would be at 0.43 for usual feet, and their ball is at 0.28."""
_BENT = np.sin(np.radians(30))
"""Sine of the angle from which a knee is bent at rest."""
_BENT_ELBOW = np.sin(np.radians(45))  # the same for elbows, which are also bent sideways a little
_STRAY_COSINE = np.cos(np.radians(40))  # at a larger angle to the forearm, the tail of a hand's bone is arbitrary
_OWN_COSINE = np.cos(np.radians(10))  # so it is where the forearm's bone is at a larger angle to the forearm


def alignments(
    source: RestSkeleton,
    of_source: BoneMap,
    target: RestSkeleton,
    of_target: BoneMap,
    palms: Mapping[str, Array] = MappingProxyType({}),
) -> dict[str, list[Array]]:
    """Return the alignment A (3, 3) of every bone of the target, by role.

    Parameters
    ----------
    source, target : RestSkeleton
        Standing upright.
    of_source, of_target : BoneMap
    palms : mapping of str to ndarray, shape (3, 3)
        By side, the axes of the target's palms, see module `palms`, where bones without a role show them.

    Notes
    -----
    Trunk and shoulders keep the target's own posture; only the direction that they face is aligned. Limbs are turned to
    the source's directions, each together with its parent and then by the shortest rotation, so that no twist is
    added; a knee that is bent at rest, as of a character that sits, shows the twist of its thigh, and an elbow that of
    its upper arm. Feet keep the target's slope and turn only about the vertical. If a skeleton has fingers, the normals
    of the palms are aligned as well, half by the forearm; those of one without fingers face down when its arms are
    raised to the sides.
    """
    F = facing(source, of_source) @ facing(target, of_target).T
    A: dict[str, list[Array]] = {}
    for role in PARENTS:
        if role not in of_target.bones:
            continue
        count = len(of_target.bones[role])
        above = A.get(parent_role(role, A), [F])[-1]
        base = role.partition(".")[0]
        if role not in of_source.bones and base not in ("spine", "neck"):
            A[role] = [above] * count
        elif base == "thigh":
            A[role] = [_thigh((source, of_source), (target, of_target), role, F)]
        elif base == "upper_arm":
            A[role] = [_upper_arm((source, of_source), (target, of_target), role, F)]
        elif base in ("forearm", "shin"):
            d_s, d_t = direction(source, of_source, role), direction(target, of_target, role)
            A[role] = [_aligned(above, d_t, d_s)]
            if base == "forearm":
                A[role] = [_half_twisted((source, of_source), (target, of_target), role, A[role][0], palms)]
        elif base == "hand":
            A[role] = [_hand((source, of_source), (target, of_target), role, above, palms)]
        elif base in FINGERS:
            A[role] = _finger((source, of_source), (target, of_target), role, above)
        elif base in ("foot", "toe"):
            A[role] = [_foot((source, of_source), (target, of_target), role, F)]
        else:
            A[role] = [F] * count
    return A


def facing(rest: RestSkeleton, bones: BoneMap) -> Array:
    """Return the rotation about the vertical (3, 3) from facing -Y, with left at +X, to the direction a skeleton
    faces.

    Raises
    ------
    BodyError
        Its left limbs are not beside its right ones; names the bones.
    """
    for limb in ("thigh", "upper_arm"):  # preferably from the hips, as shoulders may be posed
        left, right = (rest.heads[rest.indices(bones.bones[f"{limb}.{side}"])[0]] for side in SIDES)
        across = (left - right) * [1.0, 1.0, 0.0]
        width = float(np.linalg.norm(across))
        if width > 1e-6 * np.ptp(rest.heads):
            x = across / width
            return np.stack([x, np.cross(_UP, x), _UP], axis=1)
    names = [bones.bones[f"{limb}.{side}"][0] for limb in ("thigh", "upper_arm") for side in SIDES]
    raise BodyError(
        "left is not beside right at rest",
        where=f"bones {', '.join(names)}",
        todo="correct the bone map or the skeleton",
    )


def direction(rest: RestSkeleton, bones: BoneMap, role: str) -> Array:
    """Return the direction of a limb's bone at rest, to the joint of the next role or else its own tail; unit
    vector.
    """
    base, _, side = role.partition(".")
    [j] = rest.indices(bones.bones[role])
    after = f"{_NEXT.get(base, '')}.{side}"
    end = rest.heads[rest.indices(bones.bones[after])[0]] if after in bones.bones else _end(rest, j)
    d = end - rest.heads[j]
    length = float(np.linalg.norm(d))
    return d / length if length > 0 and np.isfinite(length) else np.zeros(3)


def _end(rest: RestSkeleton, j: int) -> Array:
    """Return the tail of a bone or, if it has none, the mean of its children's joints."""
    if not np.isnan(rest.tails[j]).any():
        return rest.tails[j]
    below = [k for k, p in enumerate(rest.parents) if p == j]
    return rest.heads[below].mean(axis=0) if below else rest.heads[j]


def _aligned(A: Array, d_target: Array, d_source: Array) -> Array:
    """Return A followed by the shortest rotation with which it takes one direction to the other."""
    return shortest_turn(A @ d_target, d_source) @ A


def shortest_turn(a: Array, b: Array) -> Array:
    """Return the shortest rotations (..., 3, 3) that take unit vectors a to b (..., 3)."""
    v = np.cross(a, b)
    c = np.sum(a * b, axis=-1)[..., None, None]
    S = np.zeros((*v.shape, 3))
    S[..., 0, 1], S[..., 0, 2], S[..., 1, 2] = -v[..., 2], v[..., 1], -v[..., 0]
    S -= np.swapaxes(S, -1, -2)
    opposite = c < -1 + 1e-9
    R = np.eye(3) + S + S @ S / np.where(opposite, 1.0, 1 + c)
    if opposite.any():
        side = np.cross(a, np.where(np.abs(a[..., :1]) < 0.9, [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]))
        side /= np.linalg.norm(side, axis=-1, keepdims=True)
        R = np.where(opposite, 2 * side[..., :, None] * side[..., None, :] - np.eye(3), R)
    return np.asarray(R)


def _thigh(source: _Skeleton, target: _Skeleton, role: str, F: Array) -> Array:
    """Align a thigh's direction and, if either knee is bent at rest, the axes about which the knees bend."""
    knees = [knee_axes(*rig, role.partition(".")[2]) for rig in (source, target)]
    if not any(bent for _, bent in knees):
        return _aligned(F, direction(*target, role), direction(*source, role))
    return np.asarray(knees[0][0] @ knees[1][0].T)


def knee_axes(rest: RestSkeleton, bones: BoneMap, side: str) -> tuple[Array, bool]:
    """Return the thigh's axes at rest as columns, shape (3, 3), along it, to the left about which the knee bends,
    and perpendicular to both; and whether the knee is bent. A straight one is taken to bend about the axis through the
    hips.
    """
    along, below = (direction(rest, bones, f"{part}.{side}") for part in ("thigh", "shin"))
    across, left = np.cross(along, below), facing(rest, bones)[:, 0]
    bent = bool(across @ left > _BENT)
    x = across if bent else left - along * (along @ left)
    x = x / np.linalg.norm(x)
    return np.stack([along, x, np.cross(along, x)], axis=1), bent


def _upper_arm(source: _Skeleton, target: _Skeleton, role: str, F: Array) -> Array:
    """Align an upper arm's direction and, if either elbow is bent at rest, the axes about which the elbows bend."""
    raised = [_from_t_pose(*rig, role.partition(".")[2]) for rig in (source, target)]
    if not any(bent for _, _, bent in raised):
        return _aligned(F, direction(*target, role), direction(*source, role))
    return np.asarray(raised[0][0] @ raised[1][0].T)


def _from_t_pose(rest: RestSkeleton, bones: BoneMap, side: str) -> tuple[Array, Array, bool]:
    """Return the rotations (3, 3) that take upper arm and forearm from a T pose that faces -Y, in which the elbow bends
    forward, to the pose at rest; and whether the elbow is bent, so that it shows the twist.
    """
    along, below = (direction(rest, bones, f"{part}.{side}") for part in ("upper_arm", "forearm"))
    F, out = facing(rest, bones), np.array([1.0 if side == "L" else -1.0, 0.0, 0.0])
    across = np.cross(below, along)
    bent = bool(np.linalg.norm(across) > _BENT_ELBOW)
    upper = _aligned(F, out, along)
    if bent:
        z = across * out[0] / np.linalg.norm(across)
        x = along * out[0]
        upper = np.stack([x, np.cross(z, x), z], axis=1)
    return upper, _aligned(upper, out, below), bent


def _half_twisted(source: _Skeleton, target: _Skeleton, role: str, A: Array, palms: Mapping[str, Array]) -> Array:
    """Return a forearm's alignment with half of the twist by which the palms differ, as in supination."""
    side = role.partition(".")[2]
    axes = _palms(source, target, side, A, palms)
    if axes is None:
        return A
    along = direction(*source, role)
    twist = Rotation.from_matrix(axes[0] @ axes[1].T @ A.T).as_quat()
    angle = np.arctan2(twist[:3] @ along, twist[3])
    return np.asarray(Rotation.from_rotvec(angle * along).as_matrix() @ A)


def _hand(source: _Skeleton, target: _Skeleton, role: str, above: Array, palms: Mapping[str, Array]) -> Array:
    """Align a hand's direction if both are known, and the palms' normals if either has fingers."""
    side = role.partition(".")[2]
    axes = _palms(source, target, side, above, palms)
    if axes is not None:
        return np.asarray(axes[0] @ axes[1].T)
    ways = [_hand_direction(*rig, side) for rig in (source, target)]
    return above if ways[0] is None or ways[1] is None else _aligned(above, ways[1], ways[0])


def _palms(
    source: _Skeleton, target: _Skeleton, side: str, above: Array, of_target: Mapping[str, Array]
) -> tuple[Array, Array] | None:
    """Return the axes of both palms at rest, given the alignment of the forearm; None if neither has fingers.

    A hand without fingers has the direction of its bone, or else that of the other skeleton's hand, and its palm faces
    down when the arm is raised to the side.
    """
    known = [palm_axes(*source, side), palm_axes(*target, side)]
    known[1] = of_target.get(side) if known[1] is None else known[1]
    if known[0] is not None and known[1] is not None:
        return known[0], known[1]
    if f"hand.{side}" not in source[1].bones or (known[0] is None and known[1] is None):
        return None
    forward = [
        _from_t_pose(*rig, side)[1] @ [0.0, -1.0, 0.0] if axes is None else axes[:, 0]
        for rig, axes in zip((source, target), known, strict=True)
    ]
    first, second = (
        own if own is not None or axes is None else axes[:, 1]
        for own, axes in zip((_hand_direction(*source, side), _hand_direction(*target, side)), known, strict=True)
    )
    if first is None:
        assert second is not None  # the one with fingers has a direction
        first = above @ second
    if second is None:
        second = above.T @ first
    return palm_along(first, forward[0]), palm_along(second, forward[1])


def _hand_direction(rest: RestSkeleton, bones: BoneMap, side: str) -> Array | None:
    """Return the direction of a hand at rest; None if it is unknown, as its bone's tail or that of the forearm points
    elsewhere.
    """
    if f"hand.{side}" not in bones.bones:
        return None
    along, before = direction(rest, bones, f"hand.{side}"), direction(rest, bones, f"forearm.{side}")
    [hand, forearm] = rest.indices([*bones.bones[f"hand.{side}"], *bones.bones[f"forearm.{side}"]])
    own = rest.tails[forearm] - rest.heads[forearm]
    shown = np.isnan([*own, *rest.tails[hand]]).any() or own @ before >= _OWN_COSINE * np.linalg.norm(own)
    return along if shown and along @ before >= _STRAY_COSINE else None


def _finger(source: _Skeleton, target: _Skeleton, role: str, above: Array) -> list[Array]:
    """Align each bone of a finger with the source's corresponding bone, with the hand and then by the shortest
    rotation.
    """
    chains = [rest.indices(bones.bones[role]) for rest, bones in (source, target)]
    found = []
    for k in range(len(chains[1])):
        if k < len(chains[0]):
            ways = []
            for (rest, _), chain in zip((source, target), chains, strict=True):
                end = rest.heads[chain[k + 1]] if k + 1 < len(chain) else _end(rest, chain[k])
                way = end - rest.heads[chain[k]]
                ways.append(way / max(float(np.linalg.norm(way)), 1e-12))
            believable = all(np.linalg.norm(way) > 0.5 for way in ways) and (above @ ways[1]) @ ways[0] > 0
            above = _aligned(above, ways[1], ways[0]) if believable else above
        found.append(above)
    return found


def _foot(source: _Skeleton, target: _Skeleton, role: str, F: Array) -> Array:
    """Turn a foot about the vertical to point where the source's does; toes follow the foot."""
    side = role.partition(".")[2]
    of_source, of_target = (ankle_to_ball(*rig, side) for rig in (source, target))
    if of_source is None or of_target is None:
        return F
    return _aligned(F, of_target / np.linalg.norm(of_target), of_source / np.linalg.norm(of_source))


def ankle_to_ball(rest: RestSkeleton, bones: BoneMap, side: str) -> Array | None:
    """Return the horizontal vector from the ankle to the ball of a foot at rest, shape (3,).

    None if it is unknown: the foot points down, or its tail is arbitrary, as for the last bones of chains in FBX files,
    and is nearer to the ankle than any ball, or as far as the knee.
    """
    if f"foot.{side}" not in bones.bones:
        return None
    [j] = rest.indices(bones.bones[f"foot.{side}"])
    way = to_ball(rest, bones, side)
    length, flat = float(np.linalg.norm(way)), way * [1.0, 1.0, 0.0]
    forward = facing(rest, bones) @ [0.0, -1.0, 0.0]
    [shin] = rest.indices(bones.bones[f"shin.{side}"])
    shown = flat @ forward > 0.5 * np.linalg.norm(flat) and np.linalg.norm(flat) > 0.3 * length
    below_knee = float(np.linalg.norm(rest.heads[shin] - rest.heads[j]))
    least = 0.0 if f"toe.{side}" in bones.bones else _LEAST_FOOT * below_knee
    return np.asarray(flat) if shown and least < length < below_knee else None


def foot_ends_at_ball(rest: RestSkeleton, bones: BoneMap, side: str) -> bool:
    """Whether the bone of a foot ends at its ball, where toes have bones, or would begin in a foot as short for its
    shin; otherwise it ends at the tips of the toes. False where its end is unknown.
    """
    way = ankle_to_ball(rest, bones, side)
    if way is None:
        return False
    knee, ankle = (rest.heads[rest.indices(bones.bones[f"{role}.{side}"])[0]] for role in ("shin", "foot"))
    return f"toe.{side}" in bones.bones or float(np.linalg.norm(way)) < _TO_TIPS * float(np.linalg.norm(knee - ankle))


def toe_reach(rest: RestSkeleton, bones: BoneMap, side: str) -> tuple[float, bool]:
    """Return the horizontal distance at rest from the ankle to the tips of a foot's toes, 0 if it is unknown, and
    whether the tail of the toes' bone shows it.

    It is estimated from the distance to the toes' joint where their tail is arbitrary, as importers leave it.
    """
    way = ankle_to_ball(rest, bones, side)
    if way is None:
        return 0.0, False
    ball = float(np.linalg.norm(way))
    [j] = rest.indices(bones.bones[f"toe.{side}"])
    toes = rest.tails[j] - rest.heads[j]
    ahead = float(toes @ way) / ball
    shown = bool(_MIN_TOE_LENGTH * ball < ahead < ball and ahead > 0.5 * np.linalg.norm(toes))
    return ball + (ahead if shown else _USUAL_TOE_LENGTH * ball), shown


def feet_point_back(rest: RestSkeleton, bones: BoneMap) -> bool:
    """Whether both feet point backward at rest, which means that left and right are named as seen from the front."""
    back = facing(rest, bones) @ [0.0, 1.0, 0.0]
    if not all(f"foot.{side}" in bones.bones for side in SIDES):
        return False
    ways = [to_ball(rest, bones, side) for side in SIDES]
    return all(way @ back > 0.5 * np.linalg.norm(way) for way in ways)


def to_ball(rest: RestSkeleton, bones: BoneMap, side: str) -> Array:
    """Return the vector from the ankle to the toes' joint, or to the tail of the foot's bone."""
    [j] = rest.indices(bones.bones[f"foot.{side}"])
    toe = bones.bones.get(f"toe.{side}")
    return np.asarray((_end(rest, j) if toe is None else rest.heads[rest.indices(toe)[0]]) - rest.heads[j])
