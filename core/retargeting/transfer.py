"""The motion of one skeleton as poses of another's controls, before feet are kept in place."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..body.skeleton_motion import RestSkeleton, SkeletonMotion
from ..errors import BodyError
from ..numerics import rotations
from ..numerics.arrays import Array
from .control_rig import ControlRig, RigPoses, carried
from .rest_alignment import alignments
from .roles import SIDES, BoneMap, parent_role

ROOT_MOTIONS = ("world", "in-place", "root-bone")
FEET = ("keep", "clean", "off")


@dataclass(frozen=True)
class RetargetOptions:
    """How motion is brought onto another character.

    Attributes
    ----------
    root : str
        Where the way through the world goes: "world", on the hips; "root-bone", its horizontal part on the root bone;
        "in-place", nowhere: the character stays over its first place.
    feet : str
        "keep": while the source's feet are planted the target's move as these do, in its own proportions; "clean": they
        stand quite still; "off": joint angles alone.
    hands : bool
        Hands that stand still in the world stay where they are, at the target's scale.
    scale : float, optional
        Size of the target relative to the source; by default the ratio of their legs.
    """

    root: str = "world"
    feet: str = "keep"
    hands: bool = False
    scale: float | None = None

    def __post_init__(self) -> None:
        for name, value, choices in (("root", self.root, ROOT_MOTIONS), ("feet", self.feet, FEET)):
            if value not in choices:
                raise BodyError(f"'{value}' is no choice", where=f"option {name}", todo=f"choose {', '.join(choices)}")
        if self.scale is not None and not 0 < self.scale < np.inf:
            raise BodyError(
                f"a scale of {self.scale} is impossible", where="option scale", todo="give a positive number"
            )


@dataclass(frozen=True)
class Placement:
    """Where the target moves for where the source does: a similarity about a point on the ground.

    Attributes
    ----------
    scale : float
        Metres of the target per unit of the source.
    pivot : ndarray, shape (3,)
        A point of the source's ground: under its first pose.
    ground : ndarray, shape (3,)
        The same point for the target.
    """

    scale: float
    pivot: Array
    ground: Array

    def moved(self, points: Array) -> Array:
        """Points (..., 3) of the source's world in the target's."""
        return np.asarray(self.ground + self.scale * (points - self.pivot))


def leg_length(rest: RestSkeleton, bones: BoneMap) -> float:
    """Mean length of thigh and shin and height of the ankle: the height of the hips over the ground, legs stretched."""
    lengths = []
    for side in SIDES:
        joints = [rest.heads[rest.indices(bones.bones[f"{role}.{side}"])[0]] for role in ("thigh", "shin")]
        if f"foot.{side}" in bones.bones:
            [foot] = rest.indices(bones.bones[f"foot.{side}"])
            joints.append(rest.heads[foot])
            rise = float(rest.heads[foot, 2] - rest.ground)
        else:
            [shin] = rest.indices(bones.bones[f"shin.{side}"])
            joints.append(rest.tails[shin] if np.isfinite(rest.tails[shin]).all() else 2 * joints[1] - joints[0])
            rise = 0.0
        lengths.append(float(np.linalg.norm(np.diff(joints, axis=0), axis=1).sum()) + rise)
    return float(np.mean(lengths))


def hip_centre(rest: RestSkeleton, bones: BoneMap) -> Array:
    """The middle between the hip joints at rest, shape (3,): rigs put the heads of their hip bones anywhere."""
    return np.asarray(rest.heads[[rest.indices(bones.bones[f"thigh.{side}"])[0] for side in SIDES]].mean(axis=0))


def place(source: SkeletonMotion, of_source: BoneMap, rig: ControlRig, scale: float | None = None) -> Placement:
    """Put the target's first pose over the source's, both on the ground, the target at its own size."""
    ratio = scale
    legs = leg_length(rig.rest, rig.bones) / leg_length(source.rest, of_source)
    unit = 1.0 if 0.2 < legs < 5.0 else 10.0 ** round(float(np.log10(legs)))
    if ratio is None:
        ratio = legs
    hips = source.rest.indices(of_source.bones["hips"])[0]
    first = source.positions[0, hips] * [1.0, 1.0, 0.0] + [0.0, 0.0, source.rest.ground]
    return Placement(ratio, first, first * unit)


def transfer(
    source: SkeletonMotion, of_source: BoneMap, rig: ControlRig, placement: Placement, root: str = "world"
) -> RigPoses:
    """Bring joint angles over, and the way of the hips at the target's scale.

    Parameters
    ----------
    source : SkeletonMotion
        Upright, Z up.
    of_source : BoneMap
    rig : ControlRig
    placement : Placement
    root : str
        One of `ROOT_MOTIONS`.

    Returns
    -------
    RigPoses

    Raises
    ------
    BodyError
        Root motion is to go on a root bone, and the rig has none.
    """
    A = alignments(source.rest, of_source, rig.rest, rig.bones)
    F = len(source)
    turns = np.broadcast_to(np.eye(3), (F, len(rig.rest.names), 3, 3)).copy()
    driven = np.zeros(len(rig.rest.names), bool)
    for role, alignment in A.items():
        for k, blend in enumerate(source_blends(source.rest, of_source, role, len(alignment))):
            b = rig.index(role, k)
            turns[:, b], driven[b] = blend.of(source.turns) @ alignment[k], True
    hips = rig.index("hips")
    centre = placement.moved(hip_path(source, of_source))
    if root == "in-place":
        centre[:, :2] = centre[0, :2]
    tops = {}
    if root == "root-bone":
        if "root" not in rig.bones.bones:
            raise BodyError("the rig has no root bone", where="root motion", todo="choose 'world' or 'in-place'")
        b = rig.index("root")
        over = centre * [1.0, 1.0, 0.0] + [0.0, 0.0, placement.ground[2]]
        below = hip_centre(rig.rest, rig.bones) * [1.0, 1.0, 0.0] + [0.0, 0.0, rig.rest.ground]
        tops[b], driven[b] = over + (rig.rest.heads[b] - below), True
    tops[hips] = centre - turns[:, hips] @ (hip_centre(rig.rest, rig.bones) - rig.rest.heads[hips])
    return carried(rig, turns, driven, tops)


def hip_path(source: SkeletonMotion, of_source: BoneMap) -> Array:
    """The middle between the source's hip joints, carried by its hips, shape (F, 3)."""
    [j] = source.rest.indices(of_source.bones["hips"])
    offset = hip_centre(source.rest, of_source) - source.rest.heads[j]
    return np.asarray(source.positions[:, j] + source.turns[:, j] @ offset)


@dataclass(frozen=True)
class BoneBlend:
    """A rotation between those of two bones.

    Attributes
    ----------
    low, high : int
        The bones.
    share : float
        How far it is on the way from one to the other, 0 to 1.
    """

    low: int
    high: int
    share: float = 0.0

    def of(self, turns: Array) -> Array:
        """The rotation (F, 3, 3) among those of all bones (F, J, 3, 3)."""
        low = turns[:, self.low]
        if self.low == self.high:
            return low
        step = rotations.log(np.swapaxes(low, -1, -2) @ turns[:, self.high])
        return np.asarray(low @ rotations.exp(self.share * step))


def source_blends(rest: RestSkeleton, of_source: BoneMap, role: str, count: int) -> list[BoneBlend]:
    """Which bones of a source turn each of `count` bones of a role; none where it says nothing of them."""
    if role == "root":
        return []
    chain = rest.indices(of_source.bones.get(role, ()))
    if role not in ("spine", "neck"):
        return [BoneBlend(j, j) for j in chain[:count]]
    head = of_source.bones.get("head")
    if not chain and (role == "spine" or head is None):
        return []
    bones = {-1: rest.indices(of_source.bones[parent_role(role, of_source.bones)])[-1], **dict(enumerate(chain))}
    if head is not None:
        bones[len(chain)] = rest.indices(head)[0]
    blends = chain_blends(len(chain), count, has_end=head is not None)
    return [BoneBlend(bones[blend.low], bones[blend.high], blend.share) for blend in blends]


def chain_blends(chain: int, count: int, *, has_end: bool) -> list[BoneBlend]:
    """Rotations of a chain of another number of bones.

    Bones of the shorter chain have one partner each in the longer one, first and last among them; between partners the
    rotation goes the shortest way in equal steps. So a chain brought to a longer one and back is what it was.

    Parameters
    ----------
    chain, count : int
        Number of bones of the chain that is known, and of the one wanted.
    has_end : bool
        A bone that follows on the chain takes part.

    Returns
    -------
    list of BoneBlend
        Of the known chain's bones by their places in it: -1 is the bone below it, `chain` the one that follows.
    """
    if chain >= count:
        return [BoneBlend(i, i) for i in _partners(count, chain)]
    known = {place: i for i, place in enumerate(_partners(chain, count))}
    known.setdefault(-1, -1)
    if has_end:
        known.setdefault(count, chain)
    found = []
    for i in range(count):
        low = max(k for k in known if k <= i)
        high = min((k for k in known if k >= i), default=low)
        found.append(BoneBlend(known[low], known[high], 0.0 if high == low else (i - low) / (high - low)))
    return found


def _partners(few: int, many: int) -> list[int]:
    """Partners of the bones of a short chain among those of a longer one; a single bone's is the last."""
    if few == 1:
        return [many - 1]
    return [round(i * (many - 1) / (few - 1)) for i in range(few)] if few else []
