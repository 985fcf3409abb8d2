"""A rig's bones at rest, and which control follows which: read by moving each control a little and looking.

A rig's mechanisms (constraints, drivers) are not understood but observed: what moves rigidly with a control hangs on
it, whatever lies between.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from graphlib import CycleError, TopologicalSorter
from typing import Any

import bpy
import numpy as np
from mathutils import Quaternion

from ....core.body.skeleton_motion import RestSkeleton
from ....core.errors import BodyError
from ....core.numerics import rotations
from ....core.numerics.arrays import Array, Bools
from ....core.retargeting.bone_roles.roles import SIDES, BoneMap
from ....core.retargeting.control_rig import MOVED, ControlRig, carriers_of_apart
from ....core.retargeting.rest_poses.palms import axes_of_palm, palm_bones
from ....core.retargeting.retarget import grounded
from ....core.retargeting.root_tilt import RootTilt, root_tilt, straight_turn
from ...scene_io.body.body_armature import world_frame
from ...scene_io.constraints import acts
from .rig_at_rest import at_rest, pose, posed_matrices, rest_orientations, rest_skeleton, shown_size, update

_PROBE = Quaternion((0.9553, 0.1837, 0.1342, 0.1885)).normalized()
"""How a control is turned to see what follows it: by 34 degrees about an axis that is none of its own."""
MIN_SCALE = 1e-4  # scale of a bone below which it counts as nothing
_RIGID_TOLERANCE = 1e-3
"""Radians, and lengths of the rig, within which two bones move as one."""


@dataclass(frozen=True, eq=False)
class RigReading:
    """A rig's controls, and what of it cannot follow them.

    Attributes
    ----------
    rig : ControlRig
    unsteady : tuple of str
        Controls that follow another one only in part: their rotation will differ from what is asked for.
    straight : ControlRig
        The rig as it stands upright where bones without a role lean.
    tilt : RootTilt, optional
        How much they lean.
    """

    rig: ControlRig
    unsteady: tuple[str, ...]
    straight: ControlRig
    tilt: RootTilt | None


def read_rig(
    armature: bpy.types.Object,
    bones: BoneMap,
    toe_tips: Mapping[str, float],
    ends: Mapping[str, str],
    *,
    sole: float | None,
    fingers: BoneMap | None,
) -> RigReading:
    """Read how a rig's controls stand at rest and follow each other; it must stand at rest (`at_rest`).

    Parameters
    ----------
    armature : bpy.types.Object
    bones : BoneMap
        Of the controls.
    toe_tips : mapping of str to float
        See `ControlRig`.
    ends : mapping of str to str
        Controls that end where another bone begins, which is none of them: a foot at toes that rest. The tails of all
        others are those of their bones, which importers leave anywhere.
    sole : float or None
        See `grounded`.
    fingers : BoneMap or None
        The roles of bones that are no controls, of which fingers show where palms face.

    Raises
    ------
    BodyError
        Something holds a control so that it does not turn when it is posed; names it.
    """
    names = bones.names()
    matrix, scale = world_frame(armature)
    rest = posed_matrices(armature, names)
    turn_parents, place_parents, unsteady = _followed_controls(armature, names, rest)
    heads, tails = (points @ matrix[:3, :3].T + matrix[:3, 3] for points in _bone_ends(armature, names, rest, ends))
    carriers = carriers_of_apart(RestSkeleton(tuple(names), tuple(place_parents), heads, tails), bones)
    order = _parents_first(names, turn_parents, place_parents, [carriers.get(b, -1) for b in range(len(names))])
    place = {b: i for i, b in enumerate(order)} | {-1: -1}
    skeleton = RestSkeleton(
        tuple(names[b] for b in order), tuple(place[place_parents[b]] for b in order), heads[order], tails[order]
    )
    R = rotations.orthonormal(matrix[:3, :3] / scale @ rest[:, :3, :3])
    origin = _placed_origin(armature, bones.bones["hips"][0])
    shifted = [*(bones.bones[role][0] for role in MOVED if role in bones.bones), *(names[b] for b in carriers)]
    shifts = {name: location_axes(armature, name) for name in shifted}
    longer = _longer_legs(armature, bones, skeleton)
    rig = ControlRig(
        grounded(skeleton, bones, float(origin[2]) - longer, sole),
        bones,
        tuple(place[turn_parents[b]] for b in order),
        R[order],
        np.stack([shifts.get(names[b], scale * R[b]) for b in order]),
        toe_tips,
        {} if fingers is None else _palms(armature, matrix, bones, fingers),
    )
    turned = rig.R_world_rest @ np.swapaxes(rest_orientations(armature, rig.rest.names), -1, -2)
    tilt = root_tilt(rig, turned, origin)
    straight = rig if tilt is None else tilt.straightened(rig, longer)
    return RigReading(rig, tuple(sorted(names[b] for b in np.flatnonzero(unsteady))), straight, tilt)


def _followed_controls(
    armature: bpy.types.Object, names: Sequence[str], rest: Array
) -> tuple[list[int], list[int], Bools]:
    """Turn and shift each of B controls a little, and return which one each of them turns with, which one it goes with
    (-1 for none), and which turn with another one in part, shape (B,).
    """
    size = float(np.ptp(rest[:, :3, 3], axis=0).max()) or 1.0
    refuse_mirrored(armature, names)
    moved = [moved_matrices(armature, name, names, 0.1 * size) for name in names]
    update()
    for k, name in enumerate(names):
        _refuse_held(armature, name, rest[k], moved[k][k])
    turns_with, goes_with, unsteady = _followers(rest, np.array(moved), size)
    turn_parents, place_parents = ([_nearest(own, each) for own in each] for each in (turns_with, goes_with))
    return turn_parents, place_parents, unsteady


def _bone_ends(
    armature: bpy.types.Object, names: Sequence[str], rest: Array, ends: Mapping[str, str]
) -> tuple[Array, Array]:
    """Return heads and tails of bones, shape (B, 3), in the armature's frame; `ends` as for `read_rig`."""
    lengths = np.array([armature.data.bones[name].length for name in names])
    tails = rest[:, :3, 3] + lengths[:, None] * rest[:, :3, 1]
    for name, end in ends.items():
        tails[names.index(name)] = armature.pose.bones[end].head
    return rest[:, :3, 3], tails


def turn_from_rest(armature: bpy.types.Object, bones: BoneMap) -> Array:
    """Return how what has placed a character, such as a root, turns its rest pose in the world, apart from making it
    lean, shape (3, 3).
    """
    hips = bones.bones["hips"][:1]
    matrix, scale = world_frame(armature)
    with at_rest(armature, hips):
        posed = rotations.orthonormal(matrix[:3, :3] / scale @ posed_matrices(armature, hips)[:, :3, :3])
    return straight_turn(
        rest_skeleton(armature), bones, (posed @ np.swapaxes(rest_orientations(armature, hips), 1, 2))[0]
    )


def _longer_legs(armature: bpy.types.Object, bones: BoneMap, posed: RestSkeleton) -> float:
    """Return by how much the sizes of single bones make the legs longer than the size of the hips does, metres."""
    resting = rest_skeleton(armature)
    legs = []
    for rest in (posed, resting):
        roles = [[f"{role}.{side}" for role in ("thigh", "shin", "foot")] for side in SIDES]
        joints = [rest.heads[rest.indices([bones.bones[r][0] for r in leg if r in bones.bones])] for leg in roles]
        legs.append(np.mean([np.linalg.norm(np.diff(leg, axis=0), axis=1).sum() for leg in joints]))
    return float(legs[0] - shown_size(armature, bones.bones["hips"]) * legs[1])


def _palms(armature: bpy.types.Object, matrix: Array, bones: BoneMap, fingers: BoneMap) -> dict[str, Array]:
    """Return the axes of the palms that fingers show, by side, in the world, see `ControlRig`."""
    found = {}
    for side in SIDES:
        names = palm_bones(BoneMap(dict(fingers.bones) | dict(bones.bones)), side)
        if names is not None and f"hand.{side}" in bones.bones:
            points = posed_matrices(armature, names)[:, :3, 3] @ matrix[:3, :3].T
            found[side] = axes_of_palm(*points)
    return {side: axes for side, axes in found.items() if axes is not None}


def _placed_origin(armature: bpy.types.Object, hips: str) -> Array:
    """Return where the armature's origin is carried by what has placed the hips, such as a root; world, metres."""
    matrix, _ = world_frame(armature)
    placed = posed_matrices(armature, [hips])[0] @ np.linalg.inv(np.array(armature.data.bones[hips].matrix_local))
    return np.asarray(matrix[:3, :3] @ placed[:3, 3] + matrix[:3, 3])


def _followers(rest: Array, moved: Array, size: float) -> tuple[Bools, Bools, Bools]:
    """Find what follows each of B controls, by how all of them have moved with each.

    Parameters
    ----------
    rest : ndarray, shape (B, 4, 4)
        The controls' matrices at rest.
    moved : ndarray, shape (B, B, 4, 4)
        Their matrices, the second axis, while each control is turned and shifted.
    size : float
        Of the rig, in its own length.

    Returns
    -------
    turns_with, goes_with : ndarray of bool, shape (B, B)
        Whether the first control turns, and moves, rigidly with the second.
    unsteady : ndarray of bool, shape (B,)
        Controls that turn with another one in part.
    """
    change = moved @ np.linalg.inv(rest)
    own = change[np.arange(len(rest)), np.arange(len(rest))][:, None]
    angle, apart = (
        np.linalg.norm(rotations.log(rotations.orthonormal(turn)), axis=-1)
        for turn in (change[..., :3, :3], np.swapaxes(own[..., :3, :3], -1, -2) @ change[..., :3, :3])
    )
    goal = (own[..., :3, :3] @ rest[:, :3, 3, None])[..., 0] + own[..., :3, 3]
    others = ~np.eye(len(rest), dtype=bool)
    turns = (apart < _RIGID_TOLERANCE) & others
    goes = (np.linalg.norm(moved[..., :3, 3] - goal, axis=-1) < _RIGID_TOLERANCE * size) & others
    return turns.T, goes.T, ((angle > _RIGID_TOLERANCE) & ~turns & others).any(axis=0)


def refuse_mirrored(armature: bpy.types.Object, names: Sequence[str]) -> None:
    """Raise a BodyError where a bone is scaled to nothing or mirrored, by its own scale or that of one above: no turn
    of it can be read then.
    """
    for name in names:
        bone: Any = armature.pose.bones[name]
        if bone.matrix.determinant() > MIN_SCALE**3:
            continue
        chain: list[Any] = [bone, *bone.parent_recursive]
        mirrored = bone.matrix.determinant() < -(MIN_SCALE**3)
        own = next((each for each in reversed(chain) if np.prod(each.scale) <= MIN_SCALE**3), None)
        if own is not None:
            raise BodyError(
                f"it is {'mirrored' if mirrored else 'scaled to nothing'}",
                where=f"armature {armature.name}, bone {own.name}",
                todo="clear its scale (Alt S), and its keys",
            )
        holds = [f"'{c.name}' of {each.name}" for each in chain for c in each.constraints if acts(c)]
        raise BodyError(
            f"{'it is mirrored' if mirrored else 'it has no length or no width'} as it is shown"
            f"{', held by ' + ', '.join(holds) if holds else ''}",
            where=f"armature {armature.name}, bone {bone.name}",
            todo="mute what shortens it, or move it away from where that ends" if holds else "check the bones above it",
        )


def _refuse_held(armature: bpy.types.Object, name: str, rest: Array, moved: Array) -> None:
    """Raise a BodyError where a control has not turned as it was posed."""
    turned = rotations.log(rotations.orthonormal((moved @ np.linalg.inv(rest))[:3, :3]))
    if abs(np.linalg.norm(turned) - _PROBE.angle) > 0.1 * _PROBE.angle:
        holds = [c.name for c in armature.pose.bones[name].constraints if acts(c)]
        raise BodyError(
            f"the bone does not turn as it is posed{': held by ' + ', '.join(holds) if holds else ''}",
            where=f"armature {armature.name}, bone {name}",
            todo="choose the control that moves it in a bone map, or mute what holds it",
        )


def location_axes(armature: bpy.types.Object, name: str) -> Array:
    """Return how far and where each unit of a bone's location moves it in the world, metres, shape (3, 3), as columns.

    That depends on settings of the bone and on the sizes of those above: it is shifted along each axis. The armature's
    own axes are returned for a bone that does not move.
    """
    matrix, _ = world_frame(armature)
    bone = armature.pose.bones[name]
    way = max(bone.bone.length, _RIGID_TOLERANCE)
    update()
    start, found = np.array(bone.head), np.empty((3, 3))
    for i, axis in enumerate(np.eye(3)):
        pose(bone, way * axis)
        update()
        found[:, i] = (np.array(bone.head) - start) / way
    pose(bone)
    update()
    return np.asarray(matrix[:3, :3] @ (found if abs(np.linalg.det(found)) > _RIGID_TOLERANCE**3 else np.eye(3)))


def moved_matrices(armature: bpy.types.Object, name: str, names: Sequence[str], way: float = 0.0) -> Array:
    """Return the matrices (B, 4, 4) of bones while a control is turned, and shifted where it can be."""
    bone = armature.pose.bones[name]
    pose(bone, (way, 0.7 * way, -0.4 * way), _PROBE)
    update()
    found = posed_matrices(armature, names)
    pose(bone)
    return found


def _nearest(above: Bools, follows: Bools) -> int:
    """Return, of the controls that a bone follows, the one that follows most of the others; -1 where there is none.

    Only these others count: a control that does not inherit rotation goes with controls that do not turn it.
    """
    found = np.flatnonzero(above)
    return int(found[np.argmax(follows[np.ix_(found, found)].sum(axis=1))]) if len(found) else -1


def _parents_first(names: Sequence[str], *parents: Sequence[int]) -> list[int]:
    """Controls in an order in which each comes after all that it follows, given what it follows (B,) in each way."""
    above = {b: sorted({p for p in each if p >= 0}) for b, each in enumerate(zip(*parents, strict=True))}
    try:
        return list(TopologicalSorter(above).static_order())
    except CycleError as error:
        circle = ", ".join(names[b] for b in error.args[1][1:])
        raise BodyError(
            "controls follow one another in a circle", where=f"bones {circle}", todo="mute what makes one follow"
        ) from error
