"""A motion on the controls of a rig: its bones, posed on every frame, and what of the rig had to be changed for it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import bpy

from ...core.body.skeleton_motion import SkeletonMotion
from ...core.numerics.arrays import Array, Bools
from ...core.retargeting.bone_matching import preset_of
from ...core.retargeting.bone_roles.bone_presets import BonePreset
from ...core.retargeting.bone_roles.roles import SIDES, BoneMap
from ...core.retargeting.contacts.foot_paths import toes_in_floor
from ...core.retargeting.contacts.long_feet import long_feet
from ...core.retargeting.control_rig import MOVED, ControlRig, RigPoses, local_places, local_turns
from ...core.retargeting.retarget import Retargeted, retarget
from ...core.retargeting.standing_rests import as_at_rest, standing_rig
from ...core.retargeting.transfer import RetargetOptions
from .rigs.fk_controls import FkControls, through_controls
from .rigs.held_bones import Driver, without_connections, without_drivers, without_holds
from .rigs.ik_controls import can_be_keyed, ik_bones, ik_channels, ik_roles
from .rigs.rig_at_rest import at_rest, rest_orientations, shown_size
from .rigs.rig_curves import ControlChannel, rotation_channel
from .rigs.rig_error import ShownBones
from .rigs.rig_reading import RigReading, read_rig, turn_from_rest
from .rigs.rig_settings import Owner, setting_channels, with_settings
from .rigs.single_toes import all_toes_bend, toe_channels
from .toe_tips import sole_below_ankle, standing_feet, stiff_soles, toe_tips

_FEET = tuple(f"foot.{side}" for side in SIDES)


@dataclass(frozen=True, eq=False)
class RigMotion:
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


@dataclass(frozen=True)
class Transfer:
    """What is transferred to a rig.

    Attributes
    ----------
    motion : SkeletonMotion
        Of the source, standing upright.
    bones : BoneMap
        The roles of its bones.
    options : RetargetOptions
    planted : mapping of str to ndarray of bool, shape (F,), optional
        When points of the source's soles are planted, see `core.retargeting.contacts.foot_paths.foot_paths`.
    """

    motion: SkeletonMotion
    bones: BoneMap
    options: RetargetOptions
    planted: Mapping[str, Bools] | None = None


def motion_on_rig(armature: bpy.types.Object, bones: BoneMap, transfer: Transfer) -> RigMotion:
    """Transfer a motion to a rig's controls; constraints and settings that interfere are changed, unless there is an
    error.
    """
    preset, options = preset_of(bones), transfer.options
    controls = FkControls({}, {})
    if not preset.settings:
        bones, controls = through_controls(armature, bones)
    follows = {**preset.follows, **{control: bone for bone, control in controls.by_bone.items()}}
    used = _used(bones, transfer.bones, options)
    turn = turn_from_rest(armature, bones)
    standing, resting, skins = standing_feet(armature, bones, follows, turn)
    tips, sole = toe_tips(resting, bones, used, skins), sole_below_ankle(armature, bones, follows, skins, turn)
    if options.feet != "off" and options.root != "in-place":
        sides = long_feet((transfer.motion.rest, transfer.bones), (resting, bones), tips)
        stiff = toes_in_floor(transfer.motion, transfer.bones, transfer.planted)
        sides += [side for side in stiff if side in tips and all_toes_bend(armature, bones, follows, side)]
        used = _with_toes(bones, used, [side for side in sides if can_be_keyed(armature, preset, f"toe.{side}")])
    names, ik = used.names(), [name for name in ik_bones(preset) if name in armature.pose.bones]
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
        shown = _shown_at_rest(armature, reading.rig, preset, follows)
        soles = {side: size * corners for side, corners in stiff_soles(bones, skins).items()}
        straight, result = _transferred(transfer, reading, standing, sole, soles)
        channels = _channels(armature, reading.rig, result, preset)
        channels += setting_channels(armature, settings)  # while they are set: keys may set them otherwise
    return RigMotion(
        bones=bones,
        rig=reading.rig,
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


def _transferred(
    transfer: Transfer,
    reading: RigReading,
    standing: Mapping[str, Array],
    sole: float | None,
    soles: Mapping[str, Array],
) -> tuple[ControlRig, Retargeted]:
    """Return the rig as it stands upright, by the turns of `standing_turns`, and the poses of its controls. `soles` are
    `ControlRig.stiff_soles`.
    """
    straight, turned = standing_rig(reading.straight, standing, sole) if standing else (reading.straight, None)
    straight = replace(straight, stiff_soles=soles)
    result = retarget(transfer.motion, transfer.bones, straight, transfer.options, transfer.planted)
    if turned is not None:
        result = as_at_rest(result, turned)
    return straight, result if reading.tilt is None else reading.tilt.tilted(result)


def _channels(
    armature: bpy.types.Object, rig: ControlRig, result: Retargeted, preset: BonePreset
) -> list[ControlChannel]:
    """Return what is keyed on a rig's controls, limbs that the preset drives by IK included."""
    channels = control_channels(armature, rig, result.poses, ik_roles(rig, preset))
    channels += toe_channels(armature, rig, result.poses)
    return channels + ik_channels(armature, rig, result.poses, preset)


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


def _shown_at_rest(
    armature: bpy.types.Object, rig: ControlRig, preset: BonePreset, follows: Mapping[str, str]
) -> ShownBones:
    """Return the bones that show what controls do, at rest: limbs that IK solves as they are without it, as a pole that
    is not in their plane turns them even at rest. Upper arms and thighs that IK solves count by their direction: the
    skin is rotated about their length as the controls that twist forearms and shins say.
    """
    shown = ShownBones.at_rest(armature, [shown_bone(armature, follows, name) for name in rig.rest.names])
    solved = sorted(ik_roles(rig, preset))
    shown.R_world[solved] = rest_orientations(armature, [shown.names[b] for b in solved])
    shown.heads_world[solved] = rig.rest.heads[solved]
    twisted = [limb.upper for limb in preset.ik if limb.twist in armature.pose.bones and limb.upper in rig.bones.bones]
    return replace(shown, by_direction={rig.index(role) for role in twisted})


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
