"""The animated channels of a body, and motion as values of these channels.

The channels are the location of the root and the rotation of every bone.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

import bpy
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from ....core.body.motion import Motion
from ....core.errors import BodyError
from ....core.numerics.arrays import Array
from .. import fcurves
from . import body_armature

FrameNumbers = NDArray[np.int64]


@dataclass(frozen=True)
class Channel(fcurves.BoneAttribute):
    """One animated component of an attribute of a pose bone: the root's location or a bone's quaternion."""

    index: int

    @property
    def key(self) -> str:
        """Its name in the record of what was written."""
        return f"{self.path}[{self.index}]"


def list_channels(armature: bpy.types.Object) -> list[Channel]:
    """Return the root's location (3), then the quaternion (w, x, y, z) of every part in the body's order."""
    bones = body_armature.body_bones(armature)
    for bone in bones:
        mode = armature.pose.bones[bone.name].rotation_mode
        if mode != "QUATERNION":
            raise BodyError(
                f"the bone's rotation mode is {mode}",
                where=f"armature {armature.name}, bone {bone.name}",
                todo="set it to Quaternion (WXYZ)",
            )
    root = [Channel(bones[0].name, "location", k) for k in range(3)]
    return root + [Channel(bone.name, "rotation_quaternion", k) for bone in bones for k in range(4)]


def evaluate_channels(
    armature: bpy.types.Object,
    channels: list[Channel],
    frames: FrameNumbers,
    keys: Mapping[int, fcurves.Keys] = MappingProxyType({}),
) -> Array:
    """Return the values of the channels at scene frames, shape (K, C); a channel without keys has its present value.

    `keys` are those of channels, by their numbers, that have been read already.
    """
    bag = fcurves.find_channelbag(armature)
    values = np.empty((len(frames), len(channels)))
    for c, channel in enumerate(channels):
        curve = bag.fcurves.find(channel.path, index=channel.index) if bag else None
        if curve is not None and len(curve.keyframe_points):
            values[:, c] = fcurves.values_at(curve, frames, keys.get(c))
        else:
            values[:, c] = getattr(armature.pose.bones[channel.bone], channel.attribute)[channel.index]
    return values


def channel_values(armature: bpy.types.Object, motion: Motion) -> Array:
    """Channel values of a motion, shape (F, 3 + 4 P)."""
    A, place, scale = root_frame(armature)
    turns = motion.quaternions().reshape(len(motion), 4 * motion.rotations.shape[1])
    return np.concatenate([(motion.translations - place) @ A / scale, turns], axis=1)


def motion_of_values(armature: bpy.types.Object, values: Array) -> Motion:
    """Return the motion of channel values (F, 3 + 4 P); inverse of `channel_values`."""
    A, place, scale = root_frame(armature)
    wxyz = values[:, 3:].reshape(-1, 4)
    Q = Rotation.from_quat(wxyz[:, [1, 2, 3, 0]]).as_matrix() if len(wxyz) else np.empty((0, 3, 3))
    return Motion(scale * values[:, :3] @ A.T + place, Q.reshape(len(values), (values.shape[1] - 3) // 4, 3, 3))


def root_frame(armature: bpy.types.Object) -> tuple[Array, Array, float]:
    """Axes (3, 3) and origin (3,) in the world of the root bone's location channels, and their unit in metres."""
    R_object, place, scale = body_armature.object_pose(armature)
    bones = body_armature.body_bones(armature)
    [frame], [size] = body_armature.standing_frames(armature, bones[:1])
    axes = R_object @ frame[:3, :3] if bones[0].use_local_location else R_object
    return axes, scale * R_object @ frame[:3, 3] + place, scale * size


def fixed_dofs(armature: bpy.types.Object, held: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Degrees of freedom (K, D) fixed by keyed channels (K, C)."""
    axes = _aligned_axes(armature)
    turns = held[:, 3:].reshape(len(held), (held.shape[1] - 3) // 4, 4).any(axis=2)
    moves = np.repeat(held[:, :3].any(axis=1)[:, None], 3, axis=1) if axes is None else held[:, axes]
    return np.concatenate([moves, np.repeat(turns, 3, axis=1)], axis=1)


def fixed_channels(armature: bpy.types.Object, fixed: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Channels (K, C) to key for fixed degrees of freedom (K, D): a bone's quaternion is keyed as a whole."""
    axes = _aligned_axes(armature)
    turns = fixed[:, 3:].reshape(len(fixed), fixed.shape[1] // 3 - 1, 3).any(axis=2)
    moves = np.repeat(fixed[:, :3].any(axis=1)[:, None], 3, axis=1)
    if axes is not None:
        moves = fixed[:, np.argsort(axes)]
    return np.concatenate([moves, np.repeat(turns, 4, axis=1)], axis=1)


def _aligned_axes(armature: bpy.types.Object) -> NDArray[np.int64] | None:
    """Location channel of each world axis, or None where the root's rest is askew: then all go together."""
    A = np.abs(root_frame(armature)[0])
    return np.argmax(A, axis=1) if np.allclose(A.max(axis=1), 1.0, atol=1e-5) else None
