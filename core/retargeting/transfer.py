"""Transferring the motion of one skeleton to another's controls, before feet are kept in place."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..body.skeleton_motion import RestSkeleton, SkeletonMotion
from ..choices import FEET, ROOT_MOTIONS
from ..errors import BodyError
from ..numerics import rotations
from ..numerics.arrays import Array
from .bone_roles.roles import SIDES, BoneMap, parent_role
from .control_rig import ControlRig, RigPoses, control_poses
from .rest_poses.rest_alignment import alignments


@dataclass(frozen=True)
class RetargetOptions:
    """Options of retargeting.

    Attributes
    ----------
    root : str
        What gets the motion through the world: "world", the hips; "root-bone", the root bone, for the horizontal part;
        "in-place", nothing, so that the character stays over its first position.
    feet : str
        "keep": while the source's feet are planted, the target's move as these do, at the target's scale; "clean": they
        stand completely still; "off": joint angles are copied unchanged.
    hands : bool
        Whether hands that stand still in the world stay in place, at the target's scale.
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
    """The similarity from the source's world to the target's, about a point on the ground.

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
        """Return points (..., 3) of the source's world in the target's."""
        return np.asarray(self.ground + self.scale * (points - self.pivot))


def leg_length(rest: RestSkeleton, bones: BoneMap) -> float:
    """Return the mean height of the hips above the ground with straight legs: thigh, shin and height of the ankle."""
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
    """Return the midpoint of the hip joints at rest, shape (3,); the heads of hip bones may be anywhere."""
    return np.asarray(rest.heads[[rest.indices(bones.bones[f"thigh.{side}"])[0] for side in SIDES]].mean(axis=0))


def place(source: SkeletonMotion, of_source: BoneMap, rig: ControlRig, scale: float | None = None) -> Placement:
    """Return the placement that puts the target's first pose where the source's is, both on the ground.

    Parameters
    ----------
    source : SkeletonMotion
    of_source : BoneMap
        Its bones.
    rig : ControlRig
        The target.
    scale : float, optional
        Metres of the target per unit of the source; by default the ratio of their legs' lengths.
    """
    ratio = leg_length(rig.rest, rig.bones) / leg_length(source.rest, of_source)
    # Legs of so different lengths are given in different units: so is the place where the source stands.
    unit = 1.0 if 0.2 < ratio < 5.0 else 10.0 ** round(float(np.log10(ratio)))
    hips = source.rest.indices(of_source.bones["hips"])[0]
    first = source.positions[0, hips] * [1.0, 1.0, 0.0] + [0.0, 0.0, source.rest.ground]
    return Placement(ratio if scale is None else scale, first, first * unit)


def transfer(
    source: SkeletonMotion, of_source: BoneMap, rig: ControlRig, placement: Placement, root: str = "world"
) -> RigPoses:
    """Copy joint angles, and the path of the hips at the target's scale.

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
        Root motion was requested on a root bone, and the rig has none.
    """
    A = alignments(source.rest, of_source, rig.rest, rig.bones, rig.palms)
    F = len(source)
    turns = np.broadcast_to(np.eye(3), (F, len(rig.rest.names), 3, 3)).copy()
    driven = np.zeros(len(rig.rest.names), bool)
    for role, alignment in A.items():
        for k, blend in enumerate(source_blends(source.rest, of_source, role, len(alignment))):
            b = rig.index(role, k)
            turns[:, b], driven[b] = blend.rotation(source.turns) @ alignment[k], True
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
    return control_poses(rig, turns, driven, tops)


def hip_path(source: SkeletonMotion, of_source: BoneMap) -> Array:
    """Return the path of the midpoint of the source's hip joints, in the source's unit, shape (F, 3)."""
    [j] = source.rest.indices(of_source.bones["hips"])
    offset = hip_centre(source.rest, of_source) - source.rest.heads[j]
    return np.asarray(source.positions[:, j] + source.turns[:, j] @ offset)


@dataclass(frozen=True)
class BoneBlend:
    """An interpolation between the rotations of two bones.

    Attributes
    ----------
    low, high : int
        Indices of the bones.
    share : float
        Fraction of the rotation from the first to the second, 0 to 1.
    """

    low: int
    high: int
    share: float = 0.0

    def rotation(self, turns: Array) -> Array:
        """Return the interpolated rotation (F, 3, 3) from the rotations of all bones (F, J, 3, 3)."""
        low = turns[:, self.low]
        if self.low == self.high:
            return low
        step = rotations.log(np.swapaxes(low, -1, -2) @ turns[:, self.high])
        return np.asarray(low @ rotations.exp(self.share * step))


def source_blends(rest: RestSkeleton, of_source: BoneMap, role: str, count: int) -> list[BoneBlend]:
    """Return which of the source's bones rotate the bones of a role; empty if the source lacks the role.

    Parameters
    ----------
    rest : RestSkeleton
        The source's.
    of_source : BoneMap
    role : str
    count : int
        Number of the target's bones with that role.
    """
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
    """Return how a chain's rotations are distributed over a chain with another number of bones.

    Each bone of the shorter chain has one partner in the longer one, including the first and the last; between partners
    the rotation is interpolated in equal steps. A chain transferred to a longer one and back is therefore unchanged.

    Parameters
    ----------
    chain, count : int
        Number of bones of the given chain, and of the one wanted.
    has_end : bool
        Whether the bone after the chain takes part.

    Returns
    -------
    list of BoneBlend
        With indices into the given chain; -1 is the bone before it, `chain` the one after it.
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
    """Return the partners of a short chain's bones in a longer chain; the partner of a single bone is the last."""
    if few == 1:
        return [many - 1]
    return [round(i * (many - 1) / (few - 1)) for i in range(few)] if few else []
