"""Measuring the errors of a rig with its new curves: its evaluated bones compared with where they should be."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import bpy
import numpy as np

from ....core.numerics import rotations
from ....core.numerics.arrays import Array, Ints
from ....core.retargeting.bone_roles.roles import LIMBS
from ....core.retargeting.control_rig import ControlRig, RigPoses
from ...scene_io.body.body_armature import world_frame
from ...scene_io.visited_frames import same_time
from .rig_at_rest import evaluated


def world_matrices(armature: bpy.types.Object, names: Sequence[str]) -> tuple[Array, Array]:
    """Orientations (B, 3, 3) and heads (B, 3) in the world of bones as they stand."""
    matrix, scale = world_frame(armature)
    pose = np.array([armature.pose.bones[name].matrix for name in names]).reshape(-1, 4, 4)
    R = rotations.orthonormal(matrix[:3, :3] / scale @ pose[:, :3, :3])
    return R, pose[:, :3, 3] @ matrix[:3, :3].T + matrix[:3, 3]


@dataclass(frozen=True, eq=False)
class ShownBones:
    """The bones that show the effect of each of B controls, at rest in the world.

    Attributes
    ----------
    names : tuple of str, length B
    R_world : ndarray, shape (B, 3, 3)
        Their orientations.
    heads_world : ndarray, shape (B, 3)
        Metres.
    by_direction : set of int
        Indices of those that count by where they point alone: nothing that deforms shows how they are rotated about
        their length.
    """

    names: tuple[str, ...]
    R_world: Array
    heads_world: Array
    by_direction: set[int] = field(default_factory=set)

    @classmethod
    def at_rest(cls, armature: bpy.types.Object, names: Sequence[str]) -> ShownBones:
        """Return bones of an armature that stands at rest."""
        return cls(tuple(names), *world_matrices(armature, names))


def measured_errors(
    scene: bpy.types.Scene,
    armature: bpy.types.Object,
    rig: ControlRig,
    poses: RigPoses,
    shown: ShownBones,
    *,
    frames: Ints,
    sample: Ints,
) -> dict[str, dict[str, float]]:
    """Errors by limb on some frames: mean and worst, degrees and millimetres. The motion of the armature object itself
    does not count.

    Parameters
    ----------
    shown : ShownBones
        Of the rig's controls.
    frames : ndarray of int, shape (F,)
        Scene frames of the poses.
    sample : ndarray of int
        Indices of the frames that are compared.
    """
    standing = np.array(armature.matrix_world, float)
    angles = np.empty((len(sample), len(shown.names)))
    apart = np.empty_like(angles)
    with same_time(scene), evaluated(armature):
        for i, f in enumerate(sample):
            scene.frame_set(int(frames[f]))
            R, T = world_matrices(armature, shown.names)
            back = np.linalg.inv(np.array(armature.matrix_world))
            moved = np.asarray(standing @ back, float)  # by a parent, such as a vehicle
            R, T = rotations.orthonormal(moved[:3, :3]) @ R, T @ moved[:3, :3].T + moved[:3, 3]
            wanted = poses.turns[f] @ shown.R_world
            for b in shown.by_direction:
                wanted[b] = rotations.shortest(R[b, :, 1], wanted[b, :, 1]) @ R[b]
            off = shown.heads_world - rig.rest.heads
            places = poses.places[f] + np.einsum("bij,bj->bi", poses.turns[f], off)
            angles[i] = np.degrees(np.linalg.norm(rotations.log(np.swapaxes(R, -1, -2) @ wanted), axis=-1))
            apart[i] = 1000 * np.linalg.norm(T - places, axis=-1)
    return _by_limb(rig, poses, angles, apart)


def _by_limb(rig: ControlRig, poses: RigPoses, angles: Array, apart: Array) -> dict[str, dict[str, float]]:
    found = {}
    for limb, roles in LIMBS.items():
        controls = [rig.index(role, k) for role, k, _ in rig.bones.items() if role in roles]
        controls = [b for b in controls if poses.driven[b]]
        if controls:
            found[limb] = {
                "mean_degrees": round(float(angles[:, controls].mean()), 4),
                "worst_degrees": round(float(angles[:, controls].max()), 4),
                "mean_mm": round(float(apart[:, controls].mean()), 3),
                "worst_mm": round(float(apart[:, controls].max()), 3),
            }
    return found
