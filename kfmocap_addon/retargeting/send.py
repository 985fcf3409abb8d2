"""Send to Rig: putting a motion on an armature of the open file, for the operator and the command line."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import bpy
import numpy as np

from ...core.body.skeleton_motion import SkeletonMotion
from ...core.errors import BodyError
from ...core.numerics.arrays import Bools, Ints
from ...core.retargeting.bone_matching import described, preset_of
from ...core.retargeting.bone_roles.roles import BoneMap
from ...core.retargeting.retarget import limb_changes, plant_intervals, prepared
from ...core.retargeting.standing_rests import standing_source
from ...core.retargeting.transfer import RetargetOptions
from ..scene_io import fcurves
from . import sent_actions
from .live import LiveSource, follow, refuse_inverse_kinematics, remember, stop_following
from .rig_motion import RigMotion, Transfer, motion_on_rig
from .rigs import rig_warnings
from .rigs.ik_controls import forget_twists
from .rigs.left_behind import left_behind
from .rigs.rig_at_rest import leave_rest_position
from .rigs.rig_curves import ControlChannel, CurveOptions, shifts_undone, write_channels
from .rigs.rig_error import measured_errors
from .rigs.rig_settings import setting_channels
from .target_armatures import moved_bones

_SAMPLE = 60  # frames on which the remaining error is measured


@dataclass(frozen=True)
class SendOptions:
    """Options of sending a motion to a rig.

    Attributes
    ----------
    preset : str, optional
        Name of a preset for the target; by default the one that fits.
    bones, source_bones : BoneMap, optional
        Bone maps of the target and of the source; by default they are found.
    retarget : RetargetOptions
    curves : CurveOptions
    live : LiveSource, optional
        If given, the character follows this armature by constraints, instead of getting keys: only joint angles and the
        path of the hips, without keeping feet and hands in place.
    planted : mapping of str to ndarray of bool, shape (F,), optional
        When points of the source's soles are planted, see `core.retargeting.contacts.foot_paths.foot_paths`.
    """

    preset: str | None = None
    bones: BoneMap | None = None
    source_bones: BoneMap | None = None
    retarget: RetargetOptions = field(default_factory=RetargetOptions)
    curves: CurveOptions = field(default_factory=CurveOptions)
    live: LiveSource | None = None
    planted: Mapping[str, Bools] | None = None


def send_to_rig(
    scene: bpy.types.Scene,
    source: SkeletonMotion,
    armature: bpy.types.Object,
    frame_start: int,
    options: SendOptions = SendOptions(),
) -> dict[str, Any]:
    """Put a motion on an armature, as a new action or live; returns a report of plain values.

    Parameters
    ----------
    scene : bpy.types.Scene
        The one that shows the armature.
    source : SkeletonMotion
    armature : bpy.types.Object
        If it follows a source live, it stops following.
    frame_start : int
        Scene frame of the first pose.
    options : SendOptions

    Raises
    ------
    BodyError
        The source or the armature is not human, or does not support an option; names the bone.
    """
    started = time.perf_counter()
    if armature.mode == "EDIT":
        raise BodyError("it is in edit mode", where=f"armature {armature.name}", todo="leave it first (Tab)")
    transfer = _transfer(source, options)
    bones, other_hips = (options.bones, ()) if options.bones else moved_bones(armature, options.preset)
    bones.checked([bone.name for bone in armature.data.bones], f"armature {armature.name}")
    if options.live is not None:
        refuse_inverse_kinematics(bones.preset, preset_of(bones).ik)
    stop_following(armature)
    sent = motion_on_rig(armature, bones, transfer)
    frames = frame_start + np.arange(len(source))
    shown_at_rest = leave_rest_position(armature)
    keys, behind = 0, list[str]()
    if options.live is not None:
        link = (transfer.motion, transfer.bones, options.live)
        follow(scene, armature, sent.straight, link, placement=sent.result.placement, root=options.retarget.root)
        remember(armature, sent.holds, sent.settings, sent.muted)
    else:
        keys = _keyed(armature, sent, frames, f"{armature.name} {source.name}", options.curves)
        behind = left_behind(scene, armature, sent.rig, sent.result.poses, frames)
    errors = _errors(scene, armature, sent, frames)
    return {
        **_report(transfer.motion, transfer.bones, armature, sent),
        "error": errors,
        "keys": keys,
        "frames": [int(frames[0]), int(frames[-1])],
        "warnings": [
            *shown_at_rest,
            *other_hips,
            *rig_warnings.moving_as_a_whole(scene, armature, (int(frames[0]), int(frames[-1]))),
            *_warnings(armature, sent, errors, live=options.live is not None),
            *behind,
        ],
        "seconds": round(time.perf_counter() - started, 3),
    }


def _transfer(source: SkeletonMotion, options: SendOptions) -> Transfer:
    """Return what is sent: the source, upright and as it stands. If it is followed live, it is only upright, and feet
    and hands are as joint angles have them.
    """
    upright, of_source = prepared(source, options.source_bones)
    if options.live is None:
        return Transfer(standing_source(upright, of_source), of_source, options.retarget, options.planted)
    _refuse_lying(source, upright)
    return Transfer(upright, of_source, replace(options.retarget, feet="off", hands=False), options.planted)


def _errors(scene: bpy.types.Scene, armature: bpy.types.Object, sent: RigMotion, frames: Ints) -> dict[str, Any]:
    """Measure, on some of the frames, how far the rig as it is drawn is from the motion; see `measured_errors`."""
    return measured_errors(
        scene,
        armature,
        sent.rig,
        sent.result.poses,
        sent.shown,
        frames=frames,
        sample=np.unique(np.linspace(0, len(frames) - 1, _SAMPLE).astype(int)),
    )


def _refuse_lying(given: SkeletonMotion, upright: SkeletonMotion) -> None:
    """Raise a BodyError if the source had to be turned upright, as the character would follow it lying down."""
    if not np.array_equal(given.rest.heads, upright.rest.heads):
        raise BodyError(
            "it does not stand upright at rest: it cannot be followed live",
            where=given.name,
            todo="apply its rotation (Ctrl A), or send keys",
        )


def _hold_channel(bone: str, constraint: str) -> ControlChannel:
    """Return a channel with one key that removes a constraint's influence, so that the action includes it."""
    return ControlChannel(bone, f"constraints{fcurves.property_key(constraint)}.influence", np.zeros((1, 1)))


def _keyed(armature: bpy.types.Object, sent: RigMotion, frames: Ints, action: str, curves: CurveOptions) -> int:
    """Key a motion on a rig in a new action; return the number of keys."""
    forget_twists(armature)
    earlier = sent_actions.changed_before(armature)
    holds, settings = earlier[0] | sent.holds, earlier[1] | sent.settings
    channels = [*sent.channels, *(_hold_channel(*hold) for hold in holds)]
    channels += setting_channels(armature, [setting for setting in settings if setting not in sent.settings])
    channels += shifts_undone(armature, channels)
    before = sent_actions.state_before(armature, channels)
    keys = write_channels(armature, channels, frames, action, curves)
    sent_actions.remember(
        armature,
        before,
        holds=holds,
        settings=settings,
        muted=sent.muted,
        connected=[name for name, still in sent.connected.items() if not still],
    )
    return keys


def _warnings(armature: bpy.types.Object, sent: RigMotion, errors: dict[str, Any], *, live: bool) -> list[str]:
    """Return what the animator should know of a rig that a motion was put on, by sentences."""
    return [
        *rig_warnings.standing_wrongly(armature, sent.straight),
        *rig_warnings.scaled_unevenly(armature, sent.rig),
        *rig_warnings.set_elsewhere(armature, sent.settings),
        *rig_warnings.undriven(sent.muted),
        *rig_warnings.connections(sent.connected),
        *rig_warnings.freed(armature, sent.holds, "now" if live else "in the new action"),
        *(rig_warnings.apart(sent.rig) if live else []),
        *rig_warnings.not_as_asked(sent.unsteady, errors, sent.result.placement.scale),
    ]


def _report(source: SkeletonMotion, of_source: BoneMap, armature: bpy.types.Object, sent: RigMotion) -> dict[str, Any]:
    """Return what was put on which bones, without the errors."""
    bones, rig, result = sent.bones, sent.rig, sent.result
    moved = {name for b, name in enumerate(rig.rest.names) if result.poses.driven[b]}
    return {
        "source": {"name": source.name, "frames": len(source), "fps": source.fps, "bones": described(of_source)},
        "target": {
            "armature": armature.name,
            "preset": bones.preset,
            "found_by": bones.found_by,
            "bones": described(bones),
        },
        "scale": result.placement.scale,
        "not_in_source": [name for name in bones.names() if name not in moved],
        "not_in_target": [role for role in of_source.bones if role not in bones.bones],
        "plants": plant_intervals(result),
        "turned_to_keep_feet_and_hands": limb_changes(rig, result),
    }
