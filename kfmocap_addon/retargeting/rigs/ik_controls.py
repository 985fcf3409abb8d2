"""Driving limbs through IK controls: the control at the limb's end, and the pole target."""

from __future__ import annotations

from typing import Any

import bpy
import numpy as np
from mathutils import Matrix

from ....core.numerics import rotations
from ....core.numerics.arrays import Array
from ....core.retargeting.bone_roles.bone_presets import PRESETS, BonePreset, IkLimb
from ....core.retargeting.control_rig import ControlRig, RigPoses
from ...scene_io import fcurves
from .rig_curves import ControlChannel, rotation_channel
from .rig_error import world_matrices
from .rig_reading import location_axes

_SAME = 0.01
"""Of the upper bone's length: distance of heads that are taken to be in the same place."""
_MIN_BEND = 1e-3
"""Sine of the least bend of a limb that defines its plane."""


def ik_roles(rig: ControlRig, preset: BonePreset) -> set[int]:
    """Return the controls whose rotations are not keyed, because the preset drives their limbs by IK."""
    roles = [role for limb in preset.ik for role in (limb.upper, limb.lower, limb.end)]
    return {rig.index(role) for role in roles if role in rig.bones.bones}


def ik_bones(preset: BonePreset) -> list[str]:
    """Return the names of the controls that a preset keys for limbs that are driven by IK."""
    return [name for limb in preset.ik for name in (limb.control, limb.pole, limb.twist)]


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
            channels += _unstretched(armature, rig, limb)
    return channels


def _unstretched(armature: bpy.types.Object, rig: ControlRig, limb: IkLimb) -> list[ControlChannel]:
    """Return keys that keep the lengths of a limb's bones: solvers that may stretch them bend elbows and knees less, or
    more, than the pole and the end ask for.
    """
    heads = {role: rig.rest.heads[rig.index(role)] for role in (limb.upper, limb.lower)}
    solved = [
        link
        for bone in armature.pose.bones
        for held in list[Any](bone.constraints)
        if held.type == "IK" and held.use_stretch
        for link in [bone, *bone.parent_recursive][: held.chain_count or None]
        if link.ik_stretch > 0
    ]
    names = list(dict.fromkeys(link.name for link in solved))
    _, places = world_matrices(armature, names)
    near = _SAME * np.linalg.norm(heads[limb.lower] - heads[limb.upper])
    return [
        ControlChannel(name, "ik_stretch", np.zeros((1, 1)))
        for name, place in zip(names, places, strict=True)
        if min(np.linalg.norm(place - head) for head in heads.values()) < near
    ]


def _limb(armature: bpy.types.Object, rig: ControlRig, poses: RigPoses, limb: IkLimb) -> list[ControlChannel]:
    upper, lower, end = (rig.index(role) for role in (limb.upper, limb.lower, limb.end))
    R, heads = world_matrices(armature, [limb.control, limb.pole])
    carried_by = rig.index("root") if "root" in rig.bones.bones and poses.driven[rig.index("root")] else None
    turns = poses.turns[:, end]
    place = poses.places[:, end] + turns @ (heads[0] - rig.rest.heads[end])
    [standing], joints = (a[:, (upper, lower, end)] for a in (rig.rest.heads[None], poses.places))
    normals = _bend_normals(joints, poses.turns[:, upper], standing)
    pole = _pole_path(joints, poses.turns[:, upper], standing, heads[1], normals)
    found = []
    shift = np.zeros((len(poses), 3))
    if carried_by is not None:
        shift = poses.places[:, carried_by] - rig.rest.heads[carried_by]
    for name, start, goal in ((limb.control, heads[0], place), (limb.pole, heads[1], pole)):
        along = np.linalg.inv(location_axes(armature, name))
        found.append(ControlChannel(name, "location", (goal - shift - start) @ along.T))
    found.append(rotation_channel(armature.pose.bones[limb.control], R[0].T @ turns @ R[0]))
    if normals is not None and limb.twist in armature.pose.bones:
        found.append(_twist(armature, limb, _lower_twists(joints, poses.turns[:, lower], standing, normals)))
    return found


def _twist(armature: bpy.types.Object, limb: IkLimb, twists: Array) -> ControlChannel:
    """Return the rotation of the control that twists a lower bone, for twists (F, 3) in the world at rest, radians."""
    [R], _ = world_matrices(armature, [limb.twist])
    return rotation_channel(armature.pose.bones[limb.twist], rotations.exp(twists @ R))


def _bend_normals(joints: Array, turns: Array, standing: Array) -> tuple[Array, Array] | None:
    """Return the normal of the plane in which a limb is bent at rest (3,), and on every frame (F, 3): unit vectors.
    None if it is straight at rest. The arguments are those of `_pole_path`.
    """
    at_rest = np.cross(standing[1] - standing[0], standing[2] - standing[0])
    size = np.linalg.norm(standing[1] - standing[0]) * np.linalg.norm(standing[2] - standing[0])
    if np.linalg.norm(at_rest) <= _MIN_BEND * size:
        return None
    lines, bones = (_unit(joints[:, k] - joints[:, 0]) for k in (2, 1))
    normals = np.cross(bones, lines)
    carried = turns @ at_rest
    bent = np.linalg.norm(normals, axis=1, keepdims=True) > _MIN_BEND
    forth = np.sum(normals * carried, axis=1, keepdims=True) > 0
    return _unit(at_rest), _unit(np.where(bent, np.where(forth, normals, -normals), carried))


def _pole_path(joints: Array, turns: Array, standing: Array, pole: Array, normals: tuple[Array, Array] | None) -> Array:
    """Return the positions of a pole target that put the elbow or knee where it is to be, shape (F, 3).

    Blender's solver bends a chain in the plane in which it is bent at rest, and rotates its first bone so that the same
    axis points to the pole as at rest.

    Parameters
    ----------
    joints : ndarray, shape (F, 3, 3)
        Root, elbow or knee, and end of the limb.
    turns : ndarray, shape (F, 3, 3)
        Rotations of the upper bone from rest.
    standing : ndarray, shape (3, 3)
        The joints at rest.
    pole : ndarray, shape (3,)
        The pole at rest.
    normals : tuple of ndarray, shapes (3,) and (F, 3), optional
        See `_bend_normals`.
    """
    line, bone = _unit(standing[2] - standing[0]), _unit(standing[1] - standing[0])
    aside = _across(pole - standing[0], line)
    axis = _unit(aside - line * (aside @ bone) / (line @ bone))
    lines, bones = (_unit(joints[:, k] - joints[:, 0]) for k in (2, 1))
    axes = turns @ axis
    if normals is not None:
        axes = _frames(bones, normals[1]) @ _frames(bone, normals[0]).T @ axis
    reach = np.linalg.norm(pole - standing[1])
    return np.asarray(joints[:, 1] + reach * _unit(_across(axes, lines)))


def _lower_twists(joints: Array, turns: Array, standing: Array, normals: tuple[Array, Array]) -> Array:
    """Return by how much a forearm or shin is turned about its length from where the solver has it, which bends in one
    plane alone: rotation vectors (F, 3) in the world at rest. The arguments are those of `_pole_path`, with the
    rotations of the lower bone.
    """
    along, ways = _unit(standing[2] - standing[1]), _unit(joints[:, 2] - joints[:, 1])
    solved = _frames(ways, normals[1]) @ _frames(along, normals[0]).T
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
