"""Driving limbs through IK controls: the control at the limb's end, and the pole target."""

from __future__ import annotations

import bpy
import numpy as np

from ...core.numerics.arrays import Array
from ...core.retargeting.bone_presets import BonePreset, IkLimb
from ...core.retargeting.control_rig import ControlRig, RigPoses
from .rig_curves import ControlChannel, rotation_channel
from .rig_error import world_matrices
from .rig_reading import location_axes

_BENT = 1e-3
"""Sine of the least bend of a limb that defines its plane."""


def ik_roles(rig: ControlRig, preset: BonePreset) -> set[int]:
    """Return the controls whose rotations are not keyed, because the preset drives their limbs by IK."""
    roles = [role for limb in preset.ik for role in (limb.upper, limb.lower, limb.end)]
    return {rig.index(role) for role in roles if role in rig.bones.bones}


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
    upper, lower, end = (rig.index(role) for role in (limb.upper, limb.lower, limb.end))
    R, heads = world_matrices(armature, [limb.control, limb.pole])
    carried_by = rig.index("root") if "root" in rig.bones.bones and poses.driven[rig.index("root")] else None
    turns = poses.turns[:, end]
    place = poses.places[:, end] + turns @ (heads[0] - rig.rest.heads[end])
    standing, joints = (a[:, (upper, lower, end)] for a in (rig.rest.heads[None], poses.places))
    pole = _pole_path(joints, poses.turns[:, upper], standing[0], heads[1])
    found = []
    shift = np.zeros((len(poses), 3))
    if carried_by is not None:
        shift = poses.places[:, carried_by] - rig.rest.heads[carried_by]
    for name, start, goal in ((limb.control, heads[0], place), (limb.pole, heads[1], pole)):
        along = np.linalg.inv(location_axes(armature, name))
        found.append(ControlChannel(name, "location", (goal - shift - start) @ along.T))
    found.append(rotation_channel(armature.pose.bones[limb.control], R[0].T @ turns @ R[0]))
    return found


def _pole_path(joints: Array, turns: Array, standing: Array, pole: Array) -> Array:
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
    """
    line, bone = _unit(standing[2] - standing[0]), _unit(standing[1] - standing[0])
    aside = _across(pole - standing[0], line)
    axis = _unit(aside - line * (aside @ bone) / (line @ bone))
    normal_at_rest = np.cross(bone, line)
    lines, bones = (_unit(joints[:, k] - joints[:, 0]) for k in (2, 1))
    normals = np.cross(bones, lines)
    axes = turns @ axis
    if np.linalg.norm(normal_at_rest) > _BENT:
        carried = turns @ normal_at_rest
        bent = np.linalg.norm(normals, axis=1, keepdims=True) > _BENT
        forth = np.sum(normals * carried, axis=1, keepdims=True) > 0
        normals = _unit(np.where(bent, np.where(forth, normals, -normals), carried))
        frames = np.stack([bones, normals, np.cross(bones, normals)], axis=-1)
        n0 = _unit(normal_at_rest)
        axes = frames @ np.stack([bone, n0, np.cross(bone, n0)], axis=-1).T @ axis
    reach = np.linalg.norm(pole - standing[1])
    return np.asarray(joints[:, 1] + reach * _unit(_across(axes, lines)))


def _across(v: Array, line: Array) -> Array:
    """Return the part of vectors (..., 3) that is square to unit vectors (..., 3)."""
    return np.asarray(v - line * np.sum(v * line, axis=-1, keepdims=True))


def _unit(v: Array) -> Array:
    return np.asarray(v / np.maximum(np.linalg.norm(v, axis=-1, keepdims=True), 1e-12))
