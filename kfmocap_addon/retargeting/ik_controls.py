"""Limbs driven through IK controls: the control at the limb's end, and the pole that elbow or knee points to."""

from __future__ import annotations

import bpy
import numpy as np
from numpy.typing import NDArray

from ...core.retargeting.bone_presets import BonePreset, IkLimb
from ...core.retargeting.control_rig import ControlRig, RigPoses
from .rig_curves import ControlChannel, rotation_channel
from .rig_error import world_matrices
from .rig_reading import world_frame

Array = NDArray[np.float64]


def ik_roles(rig: ControlRig, preset: BonePreset) -> set[int]:
    """Controls whose rotations are not keyed, since the preset drives their limbs by IK."""
    roles = [role for limb in preset.ik for role in (limb.upper, limb.lower, limb.end)]
    return {rig.index(role) for role in roles if role in rig.bones.bones}


def ik_channels(
    armature: bpy.types.Object, rig: ControlRig, poses: RigPoses, preset: BonePreset
) -> list[ControlChannel]:
    """Keys of the IK controls of a rig that stands at rest, for where its limbs shall be."""
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
    bend = _bend(poses.places[:, upper], poses.places[:, lower], poses.places[:, end])
    at_rest = _bend(*(rig.rest.heads[None, j] for j in (upper, lower, end)))[0]
    toward = heads[1] - rig.rest.heads[lower]
    reach = float(np.linalg.norm(toward))
    steady = poses.turns[:, upper] @ (at_rest if np.linalg.norm(at_rest) > 0.5 else toward / reach)
    weight = np.linalg.norm(bend, axis=1, keepdims=True)
    pole = poses.places[:, lower] + reach * np.where(weight > 0.5, bend, steady)
    found = []
    scale = world_frame(armature)[1]
    shift = np.zeros((len(poses), 3))
    if carried_by is not None:
        shift = poses.places[:, carried_by] - rig.rest.heads[carried_by]
    for name, axes, start, goal in ((limb.control, R[0], heads[0], place), (limb.pole, R[1], heads[1], pole)):
        found.append(ControlChannel(name, "location", (goal - shift - start) @ axes / scale))
    found.append(rotation_channel(armature.pose.bones[limb.control], R[0].T @ turns @ R[0]))
    return found


def _bend(root: Array, middle: Array, end: Array) -> Array:
    """Unit vectors (F, 3) from the line between a limb's ends to its elbow or knee; zeros where it is straight."""
    way = end - root
    along = way / np.maximum(np.linalg.norm(way, axis=1, keepdims=True), 1e-9)
    out = middle - root
    out = out - along * np.sum(out * along, axis=1, keepdims=True)
    length = np.linalg.norm(out, axis=1, keepdims=True)
    sure = length > 1e-3 * np.linalg.norm(way, axis=1, keepdims=True)
    return np.asarray(np.where(sure, out / np.maximum(length, 1e-9), 0.0))
