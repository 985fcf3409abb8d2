"""Retargeting: from a source's motion to poses of a rig's controls, and the remaining errors."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from ..body.skeleton_motion import RestSkeleton, SkeletonMotion
from ..errors import BodyError, ShotError
from ..numerics import rotations
from ..numerics.arrays import Array, Bools
from ..numerics.frame_ranges import runs
from .bone_matching import match_bones
from .bone_roles.roles import LIMBS, SIDES, BoneMap
from .contacts.foot_keeping import foot_goals, hand_goals
from .contacts.foot_paths import BALL, HEEL, FootPath, foot_paths
from .contacts.limb_goals import LimbGoal, reach_goals
from .control_rig import ControlRig, RigPoses
from .transfer import Placement, RetargetOptions, leg_length, place, transfer

DEFAULTS = RetargetOptions()
"""The options where none are given."""
_STANDING = (0.01, 0.22)
"""Range of the ankles' height above the origin, in leg lengths, for which the origin is the ground at rest."""
_SOLES = (-0.02, 0.08)
"""The same range for the lowest joints and tails of the feet, as short legs have high ankles."""


@dataclass(frozen=True, eq=False)
class Retargeted:
    """A source's motion on a rig.

    Attributes
    ----------
    poses : RigPoses
        The poses of the controls.
    by_angles : RigPoses
        The poses before feet and hands are kept in place, with the source's joint angles.
    placement : Placement
    feet : tuple of FootPath
        The source's soles, and when they were planted.
    """

    poses: RigPoses
    by_angles: RigPoses
    placement: Placement
    feet: tuple[FootPath, ...]


def prepared(source: SkeletonMotion, of_source: BoneMap | None = None) -> tuple[SkeletonMotion, BoneMap]:
    """Return a source rotated to stand upright on the ground, and the roles of its bones.

    Parameters
    ----------
    source : SkeletonMotion
        With any axis pointing up.
    of_source : BoneMap, optional
        By default found from names or positions.

    Raises
    ------
    BodyError
        It has no frames, or the bones of a human are not found in it.
    ShotError
        Its frame rate is unknown.
    """
    check_frames(source)
    if of_source is None:
        of_source = match_bones(source.rest, where=source.name)
    of_source.checked(source.rest.names, source.name)
    source = source.rotated(upright_turn(source.rest, of_source))
    return replace(source, rest=grounded(source.rest, of_source)), of_source


def check_frames(source: SkeletonMotion) -> None:
    """Check that a motion has frames, and a frame rate.

    Raises
    ------
    BodyError
        It has no frames.
    ShotError
        Its frame rate is unknown.
    """
    if not len(source):
        raise BodyError("there are no frames", where=source.name)
    if source.fps <= 0:
        raise ShotError("its frame rate is impossible", where=source.name, todo="correct the Frame Time of the file")


def upright_turn(rest: RestSkeleton, bones: BoneMap) -> Array:
    """Return the rotation (3, 3) by multiples of 90 degrees that makes the direction from knees to shoulders point
    up.
    """
    way = way_up(rest, bones)
    axis = int(np.abs(way).argmax())
    up = np.sign(way[axis]) * np.eye(3)[axis]
    if axis == 2 and up[2] > 0:
        return np.eye(3)
    turn = np.cross(up, [0.0, 0.0, 1.0]) if axis != 2 else np.array([2.0, 0.0, 0.0])
    return np.rint(rotations.exp(np.pi / 2 * turn))


def way_up(rest: RestSkeleton, bones: BoneMap) -> Array:
    """Return the vector from the middle of the knees at rest to that of the shoulders, shape (3,)."""
    ends = [
        rest.heads[[rest.indices(bones.bones[f"{role}.{side}"])[0] for side in SIDES]].mean(axis=0)
        for role in ("shin", "upper_arm")
    ]
    return np.asarray(ends[1] - ends[0])


def grounded(rest: RestSkeleton, bones: BoneMap, origin: float = 0.0, sole: float | None = None) -> RestSkeleton:
    """Return a skeleton with the height of its ground: that of its origin, or of the lowest point of its feet.

    Parameters
    ----------
    rest : RestSkeleton
    bones : BoneMap
    origin : float
        Height of the origin.
    sole : float, optional
        How far the feet reach below the ankles; by default as far as their bones do.
    """
    ankles = [name for side in SIDES for role in ("foot", "toe") for name in bones.bones.get(f"{role}.{side}", ())]
    feet = rest.indices(ankles or [name for side in SIDES for name in bones.bones[f"shin.{side}"]])
    low = float(np.nanmin(np.concatenate([rest.heads[feet, 2], rest.tails[feet, 2]])))
    # Tails of last bones are arbitrary in some files: the ankles show whether the skeleton stands on its origin.
    high = float(rest.heads[feet[0], 2])
    leg = leg_length(replace(rest, ground=high), bones)
    stands = bool(ankles) and (
        _STANDING[0] * leg <= high - origin <= _STANDING[1] * leg or _SOLES[0] * leg <= low - origin <= _SOLES[1] * leg
    )
    return replace(rest, ground=origin if stands else low if sole is None else high - sole)


def retarget(
    source: SkeletonMotion,
    of_source: BoneMap,
    rig: ControlRig,
    options: RetargetOptions = DEFAULTS,
    planted: Mapping[str, Bools] | None = None,
) -> Retargeted:
    """Retarget a motion to a rig.

    Parameters
    ----------
    source, of_source : SkeletonMotion and BoneMap
        The result of `prepared`.
    rig : ControlRig
        With its ground, see `grounded`.
    options : RetargetOptions
    planted : mapping of str to ndarray of bool, shape (F,), optional
        When points of the source's soles are planted, see `foot_paths`.

    Raises
    ------
    BodyError
        The rig does not support an option; names the bone or the option.
    """
    placement = place(source, of_source, rig, options.scale)
    by_angles = transfer(source, of_source, rig, placement, options.root)
    feet = foot_paths(source, of_source, planted=planted)
    poses = by_angles
    goals: list[LimbGoal] = []
    if options.root != "in-place":
        if options.feet != "off":
            goals, poses = foot_goals(
                feet, (source, of_source), rig, poses, placement=placement, clean=options.feet == "clean"
            )
        if options.hands:
            goals += hand_goals(source, of_source, rig, poses, placement)
        poses = reach_goals(rig, poses, goals, source.fps)
    return Retargeted(poses, by_angles, placement, tuple(feet))


def limb_changes(rig: ControlRig, result: Retargeted) -> dict[str, dict[str, float]]:
    """Return by limb how far keeping feet and hands in place has turned its bones from the source's pose, degrees."""
    found = {}
    for limb, roles in LIMBS.items():
        controls = [rig.index(role, k) for role, k, _ in rig.bones.items() if role in roles]
        controls = [b for b in controls if result.by_angles.driven[b]]
        if controls:
            before, after = (p.turns[:, controls] for p in (result.by_angles, result.poses))
            angles = np.degrees(np.linalg.norm(rotations.log(np.swapaxes(before, -1, -2) @ after), axis=-1))
            found[limb] = {"mean_degrees": float(angles.mean()), "worst_degrees": float(angles.max())}
    return found


def plant_intervals(result: Retargeted) -> Mapping[str, Mapping[str, list[tuple[int, int]]]]:
    """Return first and last frame of every plant, by foot and point of the sole."""
    return {
        f"foot.{path.side}": {"heel": runs(path.planted[:, HEEL]), "ball": runs(path.planted[:, BALL])}
        for path in result.feet
    }
