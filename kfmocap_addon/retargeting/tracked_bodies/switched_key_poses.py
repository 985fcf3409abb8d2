"""Key poses that an animator has set with inverse kinematics, kept when a rig's limbs are switched to FK controls."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from typing import Any

import bpy
import numpy as np

from ....core.body import Body
from ....core.body.kinematics import Poses, motion_of_poses, part_poses
from ....core.body.motion import Motion
from ....core.numerics import rotations
from ....core.numerics.arrays import Array, Ints
from ....core.retargeting.contacts.limb_goals import two_bone_turns
from ....core.shot.shot import KeyPoses
from ...scene_io import fcurves
from ...scene_io.body import body_armature, body_channels
from ...scene_io.keys import key_pose_curves
from ...scene_io.visited_frames import same_time
from ..rigs.rig_settings import Owner, setting_curves, trying_settings

_SAME_PLACE = 0.01
"""Distance at rest between a control and the bone that it moves, as a share of the bones' extent."""
_TURNED = 1e-3
"""Radians by which a limb must differ for its control to get keys."""
_CHANGED = 0.005
"""Distance by which a bone of a key pose may move before it is reported, metres: limbs that were stretched, tails."""
_ROUNDS = 4
"""How often controls are turned by what is left: soft limbs do not follow them rigidly."""


@dataclass(frozen=True, eq=False)
class _Limbs:
    """The parts of a body that have deforming bones in their place.

    Attributes
    ----------
    parts : ndarray of int, shape (L,)
    own : ndarray of int, shape (L,)
        The deforming bone of each.
    bones : tuple of str, length B
        All deforming bones.
    """

    parts: Ints
    own: Ints
    bones: tuple[str, ...]

    @classmethod
    def of(cls, armature: bpy.types.Object) -> _Limbs:
        """Find them by their places at rest."""
        controls = [bone.name for bone in body_armature.body_bones(armature)]
        deforming = tuple(bone.name for bone in armature.data.bones if bone.use_deform)
        if not deforming:
            return cls(np.zeros(0, np.int64), np.zeros(0, np.int64), ())
        rest = armature.data.bones  # controls and limbs may be posed apart
        there, others = (np.array([rest[name].head_local for name in names]) for names in (controls, deforming))
        apart = np.linalg.norm(there[:, None] - others, axis=-1)
        found = np.flatnonzero(apart.min(axis=1) < _SAME_PLACE * np.ptp(others, axis=0).max())
        return cls(found, apart.argmin(axis=1)[found], deforming)

    def shown(self, armature: bpy.types.Object, frames: Ints) -> Array:
        """Return axes and heads of the bones on scene frames, in the armature, shape (F, B, 3, 4)."""
        current, shown = bpy.context.scene, []
        with same_time(current):
            for frame in frames.tolist():
                current.frame_set(frame)
                posed = armature.evaluated_get(bpy.context.evaluated_depsgraph_get()).pose.bones
                shown.append([np.array(posed[name].matrix)[:3] for name in self.bones])
        return np.array(shown).reshape(len(frames), len(self.bones), 3, 4)

    def axes(self, shown: Array) -> Array:
        """Return the orientations of the parts' bones, (F, L, 3, 3), of what `shown` returns."""
        return rotations.orthonormal(shown[:, self.own, :, :3])


def keep_key_poses(
    armature: bpy.types.Object, settings: Mapping[Any, Mapping[str, float]], before: Mapping[tuple[Owner, str], Any]
) -> tuple[str, ...]:
    """Key the FK controls of limbs whose look changed when properties of their rig were set, so that key poses look as
    they did; keys of these properties get the same value. Returns what has been done, in words.

    Parameters
    ----------
    armature : bpy.types.Object
        A performer.
    settings : mapping of Owner to (mapping of str to float)
        What the properties were set to, by owner and name; there may be more than the rig has.
    before : mapping of (Owner, str) to value
        What the properties were, by owner and name.
    """
    if not before:
        return ()
    frames, limbs = _key_frames(armature), _Limbs.of(armature)
    set_before: dict[Owner, dict[str, Any]] = {}
    for (owner, key), value in before.items():
        set_before.setdefault(owner, {})[key] = value
    with trying_settings(armature, set_before):
        wanted = limbs.shown(armature, frames)
    _switch_keys(armature, {(owner, key): settings[owner][key] for owner, key in before})
    return _kept(armature, frames, limbs, wanted)


def keep_freed_poses(armature: bpy.types.Object, acting: AbstractContextManager[None]) -> tuple[str, ...]:
    """Key the bones of limbs whose look changed when constraints or drivers were muted, as `keep_key_poses` does; in
    the context `acting` these act again.
    """
    frames, limbs = _key_frames(armature), _Limbs.of(armature)
    with acting:
        wanted = limbs.shown(armature, frames)
    return _kept(armature, frames, limbs, wanted)


def _kept(armature: bpy.types.Object, frames: Ints, limbs: _Limbs, wanted: Array) -> tuple[str, ...]:
    """Key parts of the body so that bones look as they did on scene frames, `wanted`; returns what has been done, in
    words.
    """
    if not wanted.size:
        return ()
    body = body_armature.body_from_armature(armature)
    turned: set[int] = set()
    for _ in range(_ROUNDS):
        turns = limbs.axes(wanted) @ np.swapaxes(limbs.axes(limbs.shown(armature, frames)), -1, -2)
        moved = (np.linalg.norm(rotations.log(turns), axis=-1) > _TURNED).any(axis=0)
        if not moved.any():
            break
        _key(armature, frames, limbs.parts[moved], turns[:, moved])
        turned |= set(limbs.parts[moved].tolist())
    for upper, lower, end in _limbs_turned(body, turned):
        _reach(armature, frames, (upper, lower, end), wanted[:, limbs.own[limbs.parts == end][0], :, 3])
    apart = np.linalg.norm((limbs.shown(armature, frames) - wanted)[..., 3], axis=-1).max(axis=0)
    left = body_armature.world_frame(armature)[1] * apart.max()
    what = [f"keyed on {', '.join(body.names[i] for i in sorted(turned))} now"] if turned else []
    if left > _CHANGED:
        what.append(f"changed by up to {100 * left:.1f} cm, at bone {limbs.bones[int(apart.argmax())]}")
    if not what:
        return ()
    return (f"armature {armature.name}: {len(frames)} key poses set with other controls are {', and '.join(what)}",)


def _key_frames(armature: bpy.types.Object) -> Ints:
    """Return the scene frames on which any bone has keys."""
    bag = fcurves.find_channelbag(armature)
    curves = [] if bag is None else [curve for curve in bag.fcurves if fcurves.bone_of(curve.data_path)]
    keyed = [fcurves.frames_of(fcurves.get_keys(curve)) for curve in curves]
    return np.unique(np.concatenate([np.zeros(0, np.int64), *keyed]))


def _switch_keys(armature: bpy.types.Object, values: Mapping[tuple[Owner, str], float]) -> None:
    """Give all keys of properties one value each."""
    for (owner, key), value in values.items():
        for curve in setting_curves(armature, owner, key):
            frames = fcurves.frames_of(fcurves.get_keys(curve))
            same = np.full(len(frames), float(value))
            fcurves.set_keys(curve, [fcurves.new_keys(frames, same, "KEYFRAME", "CONSTANT")])


def _limbs_turned(body: Body, turned: Collection[int]) -> list[tuple[int, int, int]]:
    """Return the parts of limbs, from above, whose last one carries no other, if all three have been turned."""
    ends = [i for i in sorted(turned) if i not in body.parents]
    limbs = [(body.parents[body.parents[i]], body.parents[i], i) for i in ends if body.parents[i] in turned]
    return [limb for limb in limbs if limb[0] in turned]


def _reach(armature: bpy.types.Object, frames: Ints, limb: tuple[int, int, int], heads: Array) -> None:
    """Key a limb so that the joint of its last part is at a place, (F, 3) in the armature, on scene frames: limbs of
    inverse kinematics may be stretched a little, and then differ by centimetres there.
    """
    upper, lower, end = limb
    R, T = part_poses(body_armature.body_from_armature(armature), _motion(armature, frames))
    matrix, _ = body_armature.world_frame(armature)
    goal = heads @ matrix[:3, :3].T + matrix[:3, 3]
    first, second = two_bone_turns(T[:, upper], T[:, lower], T[:, end], goal)
    R = R.copy()
    R[:, upper], R[:, lower] = first @ R[:, upper], second @ R[:, lower]
    _write(armature, frames, (R, T), limb)


def _key(armature: bpy.types.Object, frames: Ints, parts: Ints, turns: Array) -> None:
    """Key parts of the body so that each is turned, (F, K, 3, 3) in the armature, from where it is on scene frames."""
    R, T = part_poses(body_armature.body_from_armature(armature), _motion(armature, frames))
    matrix, scale = body_armature.world_frame(armature)
    A = matrix[:3, :3] / scale
    R = R.copy()
    R[:, parts] = A @ turns @ A.T @ R[:, parts]
    _write(armature, frames, (R, T), parts.tolist())


def _motion(armature: bpy.types.Object, frames: Ints) -> Motion:
    channels = body_channels.list_channels(armature)
    return body_channels.motion_of_values(armature, body_channels.evaluate_channels(armature, channels, frames))


def _write(armature: bpy.types.Object, frames: Ints, poses: Poses, parts: Sequence[int]) -> None:
    """Key parts of the body on scene frames, whose poses are in the world."""
    body, first = body_armature.body_from_armature(armature), int(frames[0])
    fixed = np.zeros((len(frames), body.dof), bool)
    for part in parts:
        fixed[:, 3 + 3 * part : 6 + 3 * part] = True
    key_pose_curves.write_key_poses(armature, KeyPoses(frames - first, motion_of_poses(body, poses), fixed), first)
