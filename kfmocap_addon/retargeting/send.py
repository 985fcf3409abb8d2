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
from ...core.retargeting.control_rig import MOVED, ControlRig, RigPoses, local_places, local_turns
from ...core.retargeting.long_feet import long_feet
from ...core.retargeting.rests_in_stride import as_at_rest, standing_rig, standing_source
from ...core.retargeting.retarget import Retargeted, limb_changes, plant_intervals, prepared, retarget
from ...core.retargeting.roles import SIDES, BoneMap
from ...core.retargeting.transfer import RetargetOptions
from ..scene_io import fcurves
from . import sent_actions
from .live import LiveSource, follow, refuse_inverse_kinematics, remember, stop_following
from .rigs import rig_warnings
from .rigs.fk_controls import FkControls, through_controls
from .rigs.held_bones import Driver, without_connections, without_drivers, without_holds
from .rigs.ik_controls import forget_twists, ik_bones, ik_channels, ik_roles
from .rigs.rig_at_rest import at_rest, leave_rest_position, shown_size
from .rigs.rig_curves import ControlChannel, CurveOptions, rotation_channel, shifts_undone, write_channels
from .rigs.rig_error import ShownBones, measured_errors
from .rigs.rig_reading import read_rig
from .rigs.rig_settings import Owner, setting_channel, with_settings
from .target_armatures import target_bones
from .toe_tips import sole_below_ankle, standing_feet, toe_tips

_FEET = tuple(f"foot.{side}" for side in SIDES)
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
        When points of the source's soles are planted, see `core.retargeting.foot_keeping.foot_paths`.
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
    upright, of_source = prepared(source, options.source_bones)
    bones = options.bones or target_bones(armature, options.preset)
    bones.checked([bone.name for bone in armature.data.bones], f"armature {armature.name}")
    asked = options.retarget
    if options.live is not None:
        _refuse_lying(source, upright)
        refuse_inverse_kinematics(bones.preset, preset_of(bones).ik)
        asked = replace(asked, feet="off", hands=False)
    else:
        upright = standing_source(upright, of_source)
    stop_following(armature)
    sent = _on_controls(armature, bones, (upright, of_source), asked, options.planted)
    frames = frame_start + np.arange(len(upright))
    shown_at_rest = leave_rest_position(armature)
    keys = 0
    if options.live is not None:
        link = (upright, of_source, options.live)
        follow(scene, armature, sent.straight, link, placement=sent.result.placement, root=asked.root)
        remember(armature, sent.holds, sent.settings, sent.muted)
    else:
        keys = _keyed(armature, sent, frames, f"{armature.name} {upright.name}", options.curves)
    errors = _errors(scene, armature, sent, frames)
    return {
        **_report(upright, of_source, armature, sent),
        "error": errors,
        "keys": keys,
        "frames": [int(frames[0]), int(frames[-1])],
        "warnings": [
            *shown_at_rest,
            *rig_warnings.moving_as_a_whole(scene, armature, (int(frames[0]), int(frames[-1]))),
            *_warnings(armature, sent, errors, live=options.live is not None),
        ],
        "seconds": round(time.perf_counter() - started, 3),
    }


@dataclass(frozen=True, eq=False)
class _Sent:
    """A motion on the controls of a rig.

    Attributes
    ----------
    bones : BoneMap
        The rig's bones, or the controls that they follow.
    rig, straight : ControlRig
        As it stands, and upright where bones without a role lean.
    unsteady : tuple of str
        Controls that follow another one only in part.
    shown : ShownBones
        Of the rig's controls.
    result : Retargeted
    channels : list of ControlChannel
    holds, settings : dict
        The previous influence of constraints, by bone and name, and of settings of the rig, by owner and name.
    muted : tuple of Driver
        Drivers that no longer act.
    connected : mapping of str to bool
        Bones that move through the world and were connected to the one above; whether they still are.
    """

    bones: BoneMap
    rig: ControlRig
    straight: ControlRig
    unsteady: tuple[str, ...]
    shown: ShownBones
    result: Retargeted
    channels: list[ControlChannel]
    holds: dict[tuple[str, str], float]
    settings: dict[tuple[Owner, str], Any]
    muted: tuple[Driver, ...]
    connected: Mapping[str, bool]


def _errors(scene: bpy.types.Scene, armature: bpy.types.Object, sent: _Sent, frames: Ints) -> dict[str, Any]:
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


def _on_controls(
    armature: bpy.types.Object,
    bones: BoneMap,
    motion: tuple[SkeletonMotion, BoneMap],
    asked: RetargetOptions,
    planted: Mapping[str, Bools] | None,
) -> _Sent:
    """Transfer a motion, with the roles of its bones, to a rig's controls; constraints and settings that interfere are
    changed, unless there is an error.
    """
    source, of_source = motion
    preset = preset_of(bones)
    controls = FkControls({}, {})
    if not preset.settings:
        bones, controls = through_controls(armature, bones)
    follows = {**preset.follows, **{control: bone for bone, control in controls.by_bone.items()}}
    used = _used(bones, of_source, asked)
    ik = [name for name in ik_bones(preset) if name in armature.pose.bones]
    standing, resting, skins = standing_feet(armature, bones, follows)
    tips, sole = toe_tips(resting, bones, used, skins), sole_below_ankle(armature, bones, follows, skins)
    if asked.feet != "off" and asked.root != "in-place" and not preset.ik:
        used = _with_toes(bones, used, long_feet((source.rest, of_source), (resting, bones), tips))
    names = used.names()
    held = () if preset.settings else names  # the limbs of a rig with settings are switched by these
    moved = [] if preset.settings else [used.bones[role][0] for role in MOVED if role in used.bones]
    with (
        without_connections(armature, moved) as connected,
        without_drivers(armature, held, moved) as muted,
        at_rest(armature, [*names, *ik]),
        with_settings(armature, preset.settings or controls.settings) as settings,
        without_holds(armature, held, moved) as holds,
    ):
        size = shown_size(armature, [used.bones[foot][0] for foot in _FEET if foot in used.bones])
        sole, tips = None if sole is None else size * sole, {side: size * tip for side, tip in tips.items()}
        reading = read_rig(armature, used, tips, _resting_toes(bones, used), sole=sole, fingers=bones)
        rig = reading.rig
        shown = ShownBones.at_rest(armature, [shown_bone(armature, follows, name) for name in rig.rest.names])
        straight, turned = standing_rig(reading.straight, standing, sole) if standing else (reading.straight, None)
        result = retarget(source, of_source, straight, asked, planted)
        if turned is not None:
            result = as_at_rest(result, turned)
        if reading.lean is not None:
            result = reading.lean.leaned(result)
        channels = control_channels(armature, rig, result.poses, ik_roles(rig, preset))
        channels += ik_channels(armature, rig, result.poses, preset)
        keyed = [setting_channel(armature, *setting) for setting in settings]  # here: keys may set them otherwise
        channels += [channel for channel in keyed if channel is not None]
    return _Sent(
        bones=bones,
        rig=rig,
        straight=straight,
        unsteady=reading.unsteady,
        shown=shown,
        result=result,
        channels=channels,
        holds=holds,
        settings=settings,
        muted=muted,
        connected=connected,
    )


def _refuse_lying(given: SkeletonMotion, upright: SkeletonMotion) -> None:
    """Raise a BodyError if the source had to be turned upright, as the character would follow it lying down."""
    if not np.array_equal(given.rest.heads, upright.rest.heads):
        raise BodyError(
            "it does not stand upright at rest: it cannot be followed live",
            where=given.name,
            todo="apply its rotation (Ctrl A), or send keys",
        )


def _used(bones: BoneMap, of_source: BoneMap, options: RetargetOptions) -> BoneMap:
    """Return the roles for which the source has motion; all other bones stay as they are posed."""
    moving = set(of_source.bones) - {"root"}
    moving |= {"neck"} if "head" in moving else set()
    moving |= {"root"} if options.root == "root-bone" else set()
    return BoneMap({role: names for role, names in bones.bones.items() if role in moving}, bones.preset, bones.found_by)


def _with_toes(bones: BoneMap, used: BoneMap, sides: list[str]) -> BoneMap:
    """Return the roles that are used, with the toes of some sides."""
    toes = {f"toe.{side}": bones.bones[f"toe.{side}"] for side in sides}
    return BoneMap(dict(used.bones) | toes, used.preset, used.found_by)


def _resting_toes(bones: BoneMap, used: BoneMap) -> dict[str, str]:
    """Return the toes for which there is no motion, by the foot that ends where they begin."""
    sides = [side for side in SIDES if f"foot.{side}" in used.bones and f"toe.{side}" not in used.bones]
    return {used.bones[f"foot.{s}"][0]: bones.bones[f"toe.{s}"][0] for s in sides if f"toe.{s}" in bones.bones}


def shown_bone(armature: bpy.types.Object, follows: Mapping[str, str], name: str) -> str:
    """Return the bone that shows what a control has done: itself, but for those that a preset names."""
    other = follows.get(name, name)
    return other if other in armature.pose.bones else name


def control_channels(
    armature: bpy.types.Object, rig: ControlRig, poses: RigPoses, left_out: set[int]
) -> list[ControlChannel]:
    """Return the rotations of all driven controls, and places of those that move through the world, or are apart."""
    turns = local_turns(rig, poses)
    channels = []
    for b, name in enumerate(rig.rest.names):
        if poses.driven[b] and b not in left_out:
            channels.append(rotation_channel(armature.pose.bones[name], turns[:, b]))
    for b in (*(rig.index(role) for role in MOVED if role in rig.bones.bones), *rig.carriers):
        if poses.driven[b] and b not in left_out:
            channels.append(ControlChannel(rig.rest.names[b], "location", local_places(rig, poses, b)))
    return channels


def _hold_channel(bone: str, constraint: str) -> ControlChannel:
    """Return a channel with one key that removes a constraint's influence, so that the action includes it."""
    return ControlChannel(bone, f"constraints{fcurves.property_key(constraint)}.influence", np.zeros((1, 1)))


def _keyed(armature: bpy.types.Object, sent: _Sent, frames: Ints, action: str, curves: CurveOptions) -> int:
    """Key a motion on a rig in a new action; return the number of keys."""
    forget_twists(armature)
    earlier = sent_actions.changed_before(armature)
    holds, settings = earlier[0] | sent.holds, earlier[1] | sent.settings
    channels = [*sent.channels, *(_hold_channel(*hold) for hold in holds)]
    again = [setting_channel(armature, *setting) for setting in settings if setting not in sent.settings]
    channels += [channel for channel in again if channel is not None]
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


def _warnings(armature: bpy.types.Object, sent: _Sent, errors: dict[str, Any], *, live: bool) -> list[str]:
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


def _report(source: SkeletonMotion, of_source: BoneMap, armature: bpy.types.Object, sent: _Sent) -> dict[str, Any]:
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
