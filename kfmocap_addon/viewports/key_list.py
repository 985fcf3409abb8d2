"""The key poses that the panel lists, looked up by a timer after changes so that drawing does not have to wait."""

from __future__ import annotations

from dataclasses import dataclass

import bpy

from ..session import SESSION
from . import viewport
from .scene_changes import watch

_DELAY = 0.05  # seconds


@dataclass(frozen=True)
class KeyPoseEntry:
    """A scene frame with a key pose: the bones that are keyed, none for the whole body; or the tracker's proposal."""

    frame: int
    bones: tuple[str, ...] = ()
    proposed: bool = False

    @property
    def description(self) -> str:
        """Return the tooltip of the entry's button."""
        if self.proposed:
            return "Go to this frame: a proposed key pose, which the tracker may still move"
        return f"Go to this frame: a key pose of {', '.join(self.bones) if self.bones else 'the whole body'}"


@dataclass(frozen=True)
class KnownKeys:
    """The key poses of an armature, and the runs of frames, first and last, with tracked keys."""

    entries: tuple[KeyPoseEntry, ...]
    tracked: tuple[tuple[int, int], ...]


def find_key_poses(armature: bpy.types.Object) -> tuple[KeyPoseEntry, ...]:
    """Look up the key poses of an armature; empty if it is not a performer's body."""
    from ...core.errors import KFMocapError
    from ..scene_io.body import body_armature
    from ..scene_io.keys import key_pose_curves

    try:
        keyed, proposed = key_pose_curves.keyed_bones(armature)
    except KFMocapError:
        return ()
    whole = {bone.name for bone in body_armature.body_bones(armature)}
    found = [KeyPoseEntry(frame, () if bones == whole else tuple(sorted(bones))) for frame, bones in keyed.items()]
    found += [KeyPoseEntry(frame, proposed=True) for frame in proposed]
    return tuple(sorted(found, key=lambda entry: entry.frame))


def find_tracked(armature: bpy.types.Object) -> tuple[tuple[int, int], ...]:
    """Look up the runs of frames with tracked keys; empty if the armature is not a performer's body."""
    from ...core.errors import KFMocapError
    from ..scene_io.keys import motion_curves

    try:
        return tuple(motion_curves.tracked_runs(armature))
    except KFMocapError:
        return ()


def _count(armature: bpy.types.Object) -> tuple[int, int]:
    """Return identity and number of keys of an armature's action. Blender sends no update for keys that are written
    just before the frame changes, as after tracking.
    """
    from ..scene_io import fcurves

    bag = fcurves.find_channelbag(armature)
    if bag is None:
        return (0, 0)
    return (armature.animation_data.action.session_uid, sum(len(curve.keyframe_points) for curve in bag.fcurves))


class KeyPoseCache:
    """The key poses and tracked frames of all performers, by the armature's identifier in this session of Blender."""

    def __init__(self) -> None:
        self._found: dict[int, KnownKeys] = {}
        # Results of `_count` for armatures whose keys have not changed since they were looked up.
        self._current: dict[int, tuple[int, int]] = {}
        self._timer = self.look_up  # one object: Blender knows its timers by identity

    def entries(self, armature: bpy.types.Object) -> tuple[KeyPoseEntry, ...] | None:
        """Return the key poses of an armature as last looked up, None before the first time."""
        if self._current.get(armature.session_uid) != _count(armature):
            self._schedule()
        found = self._found.get(armature.session_uid)
        return None if found is None else found.entries

    def tracked(self, armature: bpy.types.Object) -> tuple[tuple[int, int], ...]:
        """Return the runs of frames with tracked keys, as last looked up with the key poses."""
        found = self._found.get(armature.session_uid)
        return () if found is None else found.tracked

    def known(self, armature: bpy.types.Object) -> KnownKeys | None:
        """Return what was looked up of an armature; None while it may have changed since."""
        if self.entries(armature) is None or self._current.get(armature.session_uid) != _count(armature):
            return None
        return self._found[armature.session_uid]

    def outdate(self) -> None:
        """Mark everything as out of date, to be looked up again."""
        self._current.clear()
        if self._found:
            self._schedule()

    def clear(self) -> None:
        """Forget everything."""
        if bpy.app.timers.is_registered(self._timer):
            bpy.app.timers.unregister(self._timer)
        self._found.clear()
        self._current.clear()

    def look_up(self) -> None:
        """Look up what has changed, and redraw."""
        for scene in bpy.data.scenes:
            for slot in scene.kfmocap.performers:
                if slot.armature is None:
                    continue
                count = _count(slot.armature)
                if self._current.get(slot.armature.session_uid) != count:
                    keys = KnownKeys(find_key_poses(slot.armature), find_tracked(slot.armature))
                    self._found[slot.armature.session_uid] = keys
                    self._current[slot.armature.session_uid] = count
        viewport.redraw(bpy.context)

    def _schedule(self) -> None:
        if not bpy.app.timers.is_registered(self._timer):
            bpy.app.timers.register(self._timer, first_interval=_DELAY)


def known_keys() -> KeyPoseCache:
    """Return what is known of key poses in this session: Blender passes no state to its handlers and panels."""
    return SESSION.of(KeyPoseCache)


@bpy.app.handlers.persistent
def _changed(_scene: bpy.types.Scene, depsgraph: bpy.types.Depsgraph) -> None:
    if any(isinstance(update.id, bpy.types.Action) for update in depsgraph.updates):
        known_keys().outdate()


@bpy.app.handlers.persistent
def _replaced(*_arguments: object) -> None:
    known_keys().outdate()


def register() -> None:
    """Watch for changes."""
    watch(_changed, _replaced)
