"""Actions with sent motion remember what a character was before, so that the motion can be taken back at any time."""

from __future__ import annotations

import json
from collections.abc import Collection, Mapping, Sequence
from typing import Any

import bpy

from ..scene_io import fcurves
from .rigs.held_bones import Driver, connect
from .rigs.rig_at_rest import update
from .rigs.rig_changes import owner_of_row, restore_rows, rows_of_holds, rows_of_settings
from .rigs.rig_curves import ControlChannel
from .rigs.rig_settings import Owner, owner_of

_BEFORE, _ACTION = "kfmocap_before", "kfmocap_action_before"
_POSE = ("location", "rotation_quaternion", "rotation_euler", "rotation_axis_angle", "ik_stretch")


def state_before(armature: bpy.types.Object, channels: Sequence[ControlChannel]) -> dict[str, Any]:
    """Return the present pose of bones that are about to get keys, and how the armature is animated."""
    data = fcurves.own_animation(armature)
    pose = []
    for channel in channels:
        if channel.attribute in _POSE:
            value = getattr(armature.pose.bones[channel.bone], channel.attribute)
            pose.append([channel.bone, channel.attribute, value if isinstance(value, float) else list(value)])
    return {
        "action": data.action,
        "slot": data.action_slot.identifier if data.action_slot is not None else "",
        "mixing": [data.action_blend_type, data.action_influence],
        "tracks": [track.name for track in data.nla_tracks],
        "solo": [track.name for track in data.nla_tracks if track.is_solo],
        "pose": pose,
    }


def remember(
    armature: bpy.types.Object,
    state: Mapping[str, Any],
    *,
    holds: Mapping[tuple[str, str], float],
    settings: Mapping[tuple[Owner, str], Any],
    muted: Sequence[Driver],
    connected: Collection[str],
) -> None:
    """Store in the armature's new action what it was before, and what has been changed for the motion."""
    action: Any = fcurves.own_animation(armature).action
    plain = {name: value for name, value in state.items() if name != "action"}
    changes = {
        "holds": rows_of_holds(holds),
        "settings": rows_of_settings(settings),
        "muted": list(muted),
        "connected": list(connected),
    }
    action[_BEFORE] = json.dumps({**plain, **changes})
    if state["action"] is not None:
        action[_ACTION] = state["action"]


def was_sent(armature: bpy.types.Object) -> bool:
    """Whether an armature's action is motion that was sent to it."""
    data = armature.animation_data
    return data is not None and data.action is not None and _BEFORE in data.action


def changed_before(
    armature: bpy.types.Object,
) -> tuple[dict[tuple[str, str], float], dict[tuple[Owner, str], Any]]:
    """Return the constraints and settings that the motion which was sent before has changed, with their present values:
    another action must have them, too, as those of library overrides are saved in actions alone.
    """
    if not was_sent(armature):
        return {}, {}
    action: Any = fcurves.own_animation(armature).action
    before = json.loads(action[_BEFORE])
    holds, settings = {}, {}
    for bone, name, _ in before["holds"]:
        constraint = armature.pose.bones[bone].constraints.get(name) if bone in armature.pose.bones else None
        if constraint is not None:
            holds[bone, name] = constraint.influence
    for name, key, _ in before["settings"]:
        owner = owner_of(armature, named := owner_of_row(name))
        if owner is not None and key in owner:
            settings[named, key] = owner[key]
    return holds, settings


def take_back(armature: bpy.types.Object) -> None:
    """Give a character the action, the pose and the settings that it had before motion was sent to it; its present
    action, which `was_sent`, is removed.
    """
    data = fcurves.own_animation(armature)
    sent: Any = data.action
    before, action = json.loads(sent[_BEFORE]), sent.get(_ACTION)
    data.action = action
    slot = next((each for each in action.slots if each.identifier == before["slot"]), None) if action else None
    if slot is not None:
        data.action_slot = slot
    for track in list(data.nla_tracks):
        if track.name not in before["tracks"] and [strip.action for strip in track.strips] == [action]:
            data.nla_tracks.remove(track)
        elif track.name in before["solo"]:
            track.is_solo = True
    data.action_blend_type, data.action_influence = before["mixing"]
    for name, attribute, value in before["pose"]:
        if name in armature.pose.bones:
            setattr(armature.pose.bones[name], attribute, value)
    restore_rows(armature, before["holds"], before["settings"], before["muted"])
    connect(armature, [name for name in before["connected"] if name in armature.data.bones], to_parent=True)
    if not sent.users:
        bpy.data.actions.remove(sent)
    armature.update_tag()
    update()
