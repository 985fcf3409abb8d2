"""Which keys an operator needs.

Where they may have changed since they were last looked up, nothing is said to be missing: the operator then says so.
"""

from __future__ import annotations

import bpy

from ..scene_io import active_performer
from ..viewports.key_list import KeyPoseEntry, known_keys


def own_key_poses(armature: bpy.types.Object) -> tuple[KeyPoseEntry, ...] | None:
    """Return the animator's key poses; None while they are not known."""
    known = known_keys().known(armature)
    return None if known is None else tuple(entry for entry in known.entries if not entry.proposed)


def _chosen_entries(context: bpy.types.Context) -> tuple[KeyPoseEntry, ...] | None:
    slot = active_performer.chosen(context)
    known = known_keys().known(slot.armature) if slot is not None else None
    return None if known is None else known.entries


def has_key_pose(context: bpy.types.Context) -> str:
    """The chosen performer has a key pose, or a proposal."""
    entries = _chosen_entries(context)
    return "" if entries is None or entries else "There is no key pose yet: use Place Joints, or Set Key Pose"


def has_other_key_pose(context: bpy.types.Context) -> str:
    """The chosen performer has a key pose or a proposal on another frame."""
    entries, now = _chosen_entries(context), context.scene.frame_current
    return "" if entries is None or any(entry.frame != now for entry in entries) else "No other frame has a key pose"


def is_between_key_poses(context: bpy.types.Context) -> str:
    """The chosen performer has key poses before and after the frame."""
    entries, now = _chosen_entries(context), context.scene.frame_current
    own = None if entries is None else [entry.frame for entry in entries if not entry.proposed]
    if own is None or (any(frame < now for frame in own) and any(frame > now for frame in own)):
        return ""
    return "There is no key pose before this frame, or none after it"


def has_whole_key_pose(context: bpy.types.Context) -> str:
    """Every performer has a key pose of the whole body."""
    for slot in active_performer.present(context.scene):
        own = own_key_poses(slot.armature)
        if own is not None and all(entry.bones for entry in own):
            return f"{slot.name} has no key pose of the whole body yet"
    return ""


def is_on_key_pose(context: bpy.types.Context) -> str:
    """A performer that is posed has a key pose on the frame, of one of the bones that are posed."""
    now = context.scene.frame_current
    for armature, bones in active_performer.posed_bones(context):
        own = own_key_poses(armature)
        if own is None or any(
            entry.frame == now and (not entry.bones or bones is None or bones & set(entry.bones)) for entry in own
        ):
            return ""
    return "There is no key pose on this frame"


def has_proposal(context: bpy.types.Context) -> str:
    """The chosen performer has a proposed key pose."""
    entries = _chosen_entries(context)
    return "" if entries is None or any(entry.proposed for entry in entries) else "No key pose is proposed"


def has_tracked_keys(context: bpy.types.Context) -> str:
    """Some performer has keys that the tracker wrote."""
    for slot in active_performer.present(context.scene):
        known = known_keys().known(slot.armature)
        if known is None or known.tracked:
            return ""
    return "There are no tracked keys: track first"


def is_tracked_around(context: bpy.types.Context) -> bool:
    """Whether there may be tracked keys between the key poses around the frame; on a key pose, on both sides of it."""
    now = context.scene.frame_current
    for slot in active_performer.present(context.scene):
        known = known_keys().known(slot.armature)
        if known is None:
            return True
        keyed = [entry.frame for entry in known.entries if not entry.proposed and not entry.bones]
        first = max((frame for frame in keyed if frame < now), default=now)
        last = min((frame for frame in keyed if frame > now), default=now)
        if any(begin <= last and first <= end for begin, end in known.tracked):
            return True
    return False
