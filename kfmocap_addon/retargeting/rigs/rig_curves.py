"""Writing poses of a rig's controls as keys, in any rotation mode, into a new action or a layer over the old one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import bpy
import numpy as np
from scipy.spatial.transform import Rotation

from ....core.errors import BodyError
from ....core.numerics import rotations
from ....core.numerics.arrays import Array, Ints
from ...editing.simplification import thin_out_curves
from ...scene_io import fcurves

_MODES = {"QUATERNION": "rotation_quaternion", "AXIS_ANGLE": "rotation_axis_angle"}
"""The attribute that holds a bone's rotation, by its mode; in all other modes it is `rotation_euler`."""


@dataclass(frozen=True, eq=False)
class ControlChannel(fcurves.BoneAttribute):
    """An animated attribute with its values, shape (F, C): a column for each component."""

    values: Array


@dataclass(frozen=True)
class CurveOptions:
    """Options for writing keys.

    Attributes
    ----------
    layer : bool
        Whether the present action is kept below the new one, as an NLA strip; if not, it is only kept in the file.
    angle, distance : float
        Tolerances for leaving out keys, radians and metres; 0 keeps a key on every frame.
    """

    layer: bool = False
    angle: float = 0.0
    distance: float = 0.0

    def __post_init__(self) -> None:
        if not (self.angle >= 0 and self.distance >= 0):
            raise BodyError("a tolerance is negative", where="tolerance", todo="give zero or more")


def rotation_channel(bone: bpy.types.PoseBone, turns: Array) -> ControlChannel:
    """Return the values of a bone's rotation (F, 3, 3) in the mode that it has, without jumps along time."""
    mode = bone.rotation_mode
    rotation = Rotation.from_matrix(turns)
    wxyz = rotations.continuous_signs(rotation.as_quat()[:, [3, 0, 1, 2]])
    if mode == "QUATERNION":
        values = wxyz
    elif mode == "AXIS_ANGLE":
        length = np.linalg.norm(wxyz[:, 1:], axis=1)
        angle = np.unwrap(2 * np.arctan2(length, wxyz[:, 0]), period=4 * np.pi)
        axis = np.where(length[:, None] > 1e-9, wxyz[:, 1:] / np.maximum(length, 1e-9)[:, None], [0.0, 1.0, 0.0])
        values = np.column_stack([angle, axis])
    else:
        values = _continuous_euler(rotation, mode)
    return ControlChannel(bone.name, _MODES.get(mode, "rotation_euler"), values)


def _continuous_euler(rotation: Rotation, order: str) -> Array:
    """Blender's Euler angles (F, 3) by axis: of the two triples that turn alike the one nearer to the frame before."""
    axes = ["XYZ".index(letter) for letter in order]
    triples = rotation.as_euler(order.lower(), suppress_warnings=True)  # about the fixed axes, as Blender counts them
    other = np.stack([triples[:, 0] + np.pi, np.pi - triples[:, 1], triples[:, 2] + np.pi], axis=1)
    found = np.empty_like(triples)
    last = np.zeros(3)
    for f, pair in enumerate(np.stack([triples, other], axis=1)):
        near = pair - 2 * np.pi * np.round((pair - last) / (2 * np.pi))
        last = near[np.argmin(np.abs(near - last).sum(axis=1))]
        found[f] = last
    by_axis = np.empty_like(found)
    by_axis[:, axes] = found
    return by_axis


def shifts_undone(armature: bpy.types.Object, channels: Sequence[ControlChannel]) -> list[ControlChannel]:
    """Return one key each that puts bones whose rotations are keyed back to where they hang, if they have been shifted
    from there, or an action shifts them: they would be apart from the motion.
    """
    placed = {channel.bone for channel in channels if channel.attribute == "location"}
    turned = dict.fromkeys(channel.bone for channel in channels if channel.attribute.startswith("rotation_"))
    keyed = {fcurves.bone_of(path) for path in fcurves.animated_paths(armature) if path.endswith(".location")}
    return [
        ControlChannel(name, "location", np.zeros((1, 3)))
        for name in turned
        if name not in placed and (name in keyed or armature.pose.bones[name].location.length > 0)
    ]


def write_channels(
    armature: bpy.types.Object,
    channels: list[ControlChannel],
    frames: Ints,
    name: str,
    options: CurveOptions,
) -> int:
    """Write channels into a new action of the armature; returns the number of keys.

    Parameters
    ----------
    frames : ndarray of int, shape (F,)
        Scene frames.
    name : str
        Of the action.
    """
    _make_room(armature, options.layer)
    armature.animation_data.action = None
    bag = fcurves.ensure_channelbag_of(armature, bpy.data.actions.new(name))
    count = 0
    for channel in channels:
        sparse = len(channel.values) == len(frames) and (options.angle > 0 or options.distance > 0)
        curves = []
        for index, column in enumerate(channel.values.T):
            curve = fcurves.ensure_fcurve(bag, channel.path, index, channel.bone)
            fcurves.set_keys(curve, [fcurves.new_keys(frames[: len(column)], column, "KEYFRAME", "LINEAR")])
            curves.append(curve)
        if sparse:
            is_location = channel.attribute == "location"
            tolerance = options.distance if is_location else options.angle
            if tolerance > 0:
                thin_out_curves(curves, tolerance, turns=channel.attribute == "rotation_quaternion")
        count += sum(len(curve.keyframe_points) for curve in curves)
    return count


def _make_room(armature: bpy.types.Object, layer: bool) -> None:
    """Keep the present action, as a strip below or in the file, and make way for the new one."""
    data = fcurves.own_animation(armature)
    fcurves.show_action(armature)
    if data.action is None:
        return
    if not layer:
        data.action.use_fake_user = True
        return
    action, slot = data.action, data.action_slot
    track = data.nla_tracks.new()
    track.name = action.name
    strip = track.strips.new(action.name, round(action.frame_range[0]), action)
    if slot is not None:
        strip.action_slot = slot
    data.use_nla = True
