"""Driving limbs through IK controls: the control at the limb's end, and the pole target."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import bpy
import numpy as np
from mathutils import Matrix

from ....core.numerics import rotations
from ....core.numerics.arrays import Array
from ....core.retargeting.bone_roles.bone_presets import PRESETS, BonePreset, IkLimb
from ....core.retargeting.control_rig import ControlRig, RigPoses
from ...scene_io import fcurves
from .rig_at_rest import rest_orientations
from .rig_curves import ControlChannel, rotation_channel
from .rig_error import world_matrices
from .rig_reading import location_axes

_MIN_BEND = 1e-3
"""Sine of the least bend of a limb at rest that defines its plane."""
_STRAIGHT = 1e-3
"""Sine of a bend that counts for the rotation about a limb's length as much as that of its upper bone."""


def ik_roles(rig: ControlRig, preset: BonePreset) -> set[int]:
    """Return the controls whose rotations are not keyed, because the preset drives their limbs by IK."""
    roles = [role for limb in preset.ik for role in (limb.upper, limb.lower, limb.end)]
    return {rig.index(role) for role in roles if role in rig.bones.bones}


def ik_bones(preset: BonePreset) -> list[str]:
    """Return the names of the controls that a preset keys for limbs that are driven by IK."""
    beyond = [limb.beyond[1] for limb in preset.ik if limb.beyond is not None]
    return [name for limb in preset.ik for name in (limb.control, limb.pole, limb.twist)] + beyond


def can_be_keyed(armature: bpy.types.Object, preset: BonePreset, role: str) -> bool:
    """Return whether a preset has a control for what hangs on the end of a limb, if it drives the limb by IK."""
    controls = [limb.beyond[1] for limb in preset.ik if limb.beyond is not None and limb.beyond[0] == role]
    return not controls or controls[0] in armature.pose.bones


def forget_twists(armature: bpy.types.Object) -> None:
    """Take the twists back that keys of the present action have given limbs that were driven by IK."""
    bag = fcurves.find_channelbag(armature)
    keyed = {curve.data_path for curve in bag.fcurves} if bag is not None else set()
    for name in {limb.twist for preset in PRESETS.values() for limb in preset.ik}:
        bone: Any = armature.pose.bones.get(name)
        if bone is not None and any(path.startswith(fcurves.bone_path(name, "rotation")) for path in keyed):
            bone.matrix_basis = Matrix.LocRotScale(bone.location, None, bone.scale)


def ik_channels(
    armature: bpy.types.Object, rig: ControlRig, poses: RigPoses, preset: BonePreset
) -> list[ControlChannel]:
    """Return the keys of a rig's IK controls that bring its limbs to their poses; the rig must be at rest."""
    channels = []
    for limb in preset.ik:
        roles = (limb.upper, limb.lower, limb.end)
        names = [name for name in (limb.control, limb.pole) if name in armature.pose.bones]
        if len(names) == 2 and all(role in rig.bones.bones and poses.driven[rig.index(role)] for role in roles):
            channels += _limb(armature, rig, poses, limb)
    return channels


def _limb(armature: bpy.types.Object, rig: ControlRig, poses: RigPoses, limb: IkLimb) -> list[ControlChannel]:
    solver = _solver_of(armature, limb.pole)
    if solver is None:
        return []
    upper, lower, end = (rig.index(role) for role in (limb.upper, limb.lower, limb.end))
    R, heads = world_matrices(armature, [limb.control, limb.pole])
    carried_by = rig.index("root") if "root" in rig.bones.bones and poses.driven[rig.index("root")] else None
    turns = poses.turns[:, end]
    place = poses.places[:, end] + turns @ (heads[0] - rig.rest.heads[end])
    [standing], joints = (a[:, (upper, lower, end)] for a in (rig.rest.heads[None], poses.places))
    turned, bent = _solved_turns(joints, poses.turns[:, upper], standing, solver.hinge)
    pole = _pole_path(joints, turned @ solver.up, float(np.linalg.norm(heads[1] - standing[1])))
    found = []
    shift = np.zeros((len(poses), 3))
    if carried_by is not None:
        shift = poses.places[:, carried_by] - rig.rest.heads[carried_by]
    for name, start, goal in ((limb.control, heads[0], place), (limb.pole, heads[1], pole)):
        along = np.linalg.inv(location_axes(armature, name))
        found.append(ControlChannel(name, "location", (goal - shift - start) @ along.T))
    found.append(rotation_channel(armature.pose.bones[limb.control], R[0].T @ turns @ R[0]))
    if bent is not None and limb.twist in armature.pose.bones:
        along = _unit(standing[2] - standing[1])
        [R], _ = world_matrices(armature, [limb.twist])
        twists = _twists(along, poses.turns[:, lower], bent)
        found.append(rotation_channel(armature.pose.bones[limb.twist], rotations.exp(twists @ R)))
    found += _beyond(armature, rig, poses, limb)
    # Stretched limbs bend elbows and knees less, or more, than the pole and the end ask for.
    return [*found, *(ControlChannel(name, "ik_stretch", np.zeros((1, 1))) for name in solver.stretching)]


def _beyond(armature: bpy.types.Object, rig: ControlRig, poses: RigPoses, limb: IkLimb) -> list[ControlChannel]:
    """Return the rotation from the limb's end of the control of what hangs on it, if it is posed."""
    role, name = limb.beyond or ("", "")
    if role not in rig.bones.bones or not poses.driven[rig.index(role)] or name not in armature.pose.bones:
        return []
    [R], _ = world_matrices(armature, [name])
    bent = np.swapaxes(poses.turns[:, rig.index(limb.end)], -1, -2) @ poses.turns[:, rig.index(role)]
    return [rotation_channel(armature.pose.bones[name], R.T @ bent @ R)]


@dataclass(frozen=True, eq=False)
class _LimbSolver:
    """How the IK solver of a limb is set up.

    Attributes
    ----------
    up : ndarray, shape (3,)
        Axis across the upper bone that points to the pole: a unit vector in the world at rest.
    hinge : ndarray, shape (3,), optional
        Axis, in the world at rest, about which alone the lower bone bends.
    stretching : tuple of str
        Bones that it may stretch.
    """

    up: Array
    hinge: Array | None
    stretching: tuple[str, ...]


def _solver_of(armature: bpy.types.Object, pole: str) -> _LimbSolver | None:
    """Return the IK solver of the limb that has a pole target, None if there is none."""
    for bone in armature.pose.bones:
        for held in list[Any](bone.constraints):
            if held.type == "IK" and held.pole_subtarget == pole:
                chain = [bone, *bone.parent_recursive][: held.chain_count or None]
                last, first = rest_orientations(armature, [bone.name, chain[-1].name])
                free = [k for k, locked in enumerate((bone.lock_ik_x, bone.lock_ik_y, bone.lock_ik_z)) if not locked]
                up = first @ [np.cos(held.pole_angle), 0.0, np.sin(held.pole_angle)]
                stretching = tuple(link.name for link in chain if held.use_stretch and link.ik_stretch > 0)
                return _LimbSolver(up, last[:, free[0]] if len(free) == 1 else None, stretching)
    return None


def _solved_turns(
    joints: Array, turns: Array, standing: Array, hinge: Array | None
) -> tuple[Array, Array] | tuple[Array, None]:
    """Return the rotations (F, 3, 3) from rest of a limb's upper and lower bone as the IK solver has them. It bends the
    limb about its hinge, or else in the plane in which it is bent at rest; if it is straight there, the plane is
    unknown, and the lower bone's rotation as well.

    Parameters
    ----------
    joints : ndarray, shape (F, 3, 3)
        Root, elbow or knee, and end of the limb.
    turns : ndarray, shape (F, 3, 3)
        Rotations of the upper bone from rest that are wanted; a limb that is nearly straight has them.
    standing : ndarray, shape (3, 3)
        The joints at rest.
    hinge : ndarray, shape (3,), optional
        Unit vector in the world at rest.
    """
    upper, lower = (_unit(standing[k + 1] - standing[k]) for k in (0, 1))
    at_rest = np.cross(upper, lower)
    if np.linalg.norm(at_rest) <= _MIN_BEND:
        return turns, None
    bones, ways = (_unit(joints[:, k + 1] - joints[:, k]) for k in (0, 1))
    axis = _unit(at_rest) if hinge is None else hinge * (np.sign(hinge @ at_rest) or 1.0)
    bent = rotations.exp(_hinge_angles(upper, lower, axis, np.sum(bones * ways, axis=1))[:, None] * axis)
    from_rest = _unit(np.cross(upper, bent @ lower))
    normals = np.cross(bones, ways)
    forth = np.sum(normals * (turns @ axis), axis=1, keepdims=True) > 0
    roll = _STRAIGHT * np.einsum("fij,fj->fi", turns, from_rest)
    normals = _unit(_across(np.where(forth, normals, -normals) + roll, bones))
    standing_frames = _frames(np.broadcast_to(upper, bones.shape), from_rest)
    solved = _frames(bones, normals) @ np.swapaxes(standing_frames, -1, -2)
    return solved, solved @ bent


def _hinge_angles(upper: Array, lower: Array, axis: Array, cosines: Array) -> Array:
    """Return the angles (F,), radians, by which a lower bone is turned about a hinge for given cosines (F,) of the
    angle between both bones. The hinge need not be perpendicular to them; they bend to the side as at rest.
    """
    constant = (axis @ upper) * (axis @ lower)
    middle = np.arctan2(upper @ np.cross(axis, lower), upper @ lower - constant)
    reach = np.hypot(upper @ lower - constant, upper @ np.cross(axis, lower))
    aside = np.arccos(np.clip((cosines - constant) / max(float(reach), 1e-12), -1.0, 1.0))
    return np.asarray(middle + np.where(middle > 0, -aside, aside))


def _pole_path(joints: Array, axes: Array, reach: float) -> Array:
    """Return the positions of a pole target (F, 3) at a distance from the line between root and end of a limb, whose
    joints are at (F, 3, 3), so that given axes (F, 3) of its first bone point to it.
    """
    lines = _unit(joints[:, 2] - joints[:, 0])
    bones = joints[:, 1] - joints[:, 0]
    return np.asarray(joints[:, 1] - _across(bones, lines) + reach * _unit(_across(axes, lines)))


def _twists(along: Array, turns: Array, solved: Array) -> Array:
    """Return by how much a bone that points along a unit vector (3,) at rest is turned about its length from where the
    solver has it: rotation vectors (F, 3) in the world at rest.
    """
    twist = rotations.log(np.swapaxes(solved, -1, -2) @ turns) @ along
    return np.asarray(twist[:, None] * along)


def _frames(ways: Array, normals: Array) -> Array:
    """Return axes (..., 3, 3), as columns: unit vectors (..., 3), and normals perpendicular to them (..., 3)."""
    return np.stack([ways, normals, np.cross(ways, normals)], axis=-1)


def _across(v: Array, line: Array) -> Array:
    """Return the part of vectors (..., 3) that is perpendicular to unit vectors (..., 3)."""
    return np.asarray(v - line * np.sum(v * line, axis=-1, keepdims=True))


def _unit(v: Array) -> Array:
    return np.asarray(v / np.maximum(np.linalg.norm(v, axis=-1, keepdims=True), 1e-12))
