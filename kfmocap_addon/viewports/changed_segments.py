"""Whether anything of a shot has changed since it was tracked.

It is looked up by a timer once changes have come to rest: it takes too long for drawing a button.
"""

from __future__ import annotations

import time

import bpy

from ..session import SESSION
from . import viewport
from .scene_changes import watch

_REST = 0.4
"""Seconds without a change after which it is looked up."""
_WATCHED_TYPES = (bpy.types.Action, bpy.types.Scene, bpy.types.Camera)
_GEOMETRY_TYPES = (bpy.types.Armature, bpy.types.Mesh)


def find_changed(scene: bpy.types.Scene) -> bool:
    """Whether some segment of a scene's shot has changed since it was tracked, or was never tracked.

    Also where the shot cannot be read: whoever tracks it is told why.
    """
    from ...core.errors import KFMocapError
    from ..scene_io import prop_holds, tracked_segments
    from ..scene_io import scene as scenes

    try:
        shot = prop_holds.with_grips_of_scene(scene, scenes.shot_from_scene(scene))
        return bool(tracked_segments.out_of_date(scene, shot))
    except KFMocapError:
        return True


class ChangeCache:
    """What `find_changed` has found, by the scene's identifier in this session of Blender, until something changes."""

    def __init__(self) -> None:
        self._known: dict[int, bool] = {}
        self._asked: set[int] = set()
        self._timer = self._look_up_at_rest  # one object: Blender knows its timers by identity
        self._changed = 0.0

    def known(self, scene: bpy.types.Scene) -> bool | None:
        """Whether something has changed; None until it has been looked up."""
        if scene.session_uid not in self._known and scene.session_uid not in self._asked:
            self._asked.add(scene.session_uid)
            self._schedule()
        return self._known.get(scene.session_uid)

    def outdate(self) -> None:
        """Forget what is known; what has been asked for is looked up again once nothing changes any more."""
        self._asked.update(self._known)
        self._known.clear()
        if self._asked:
            self._schedule()

    def clear(self) -> None:
        """Forget everything."""
        if bpy.app.timers.is_registered(self._timer):
            bpy.app.timers.unregister(self._timer)
        self._known.clear()
        self._asked.clear()

    def look_up(self) -> None:
        """Look up what has been asked for, and redraw."""
        asked, self._asked = self._asked, set()
        for scene in bpy.data.scenes:
            if scene.session_uid in asked:
                self._known[scene.session_uid] = find_changed(scene)
        viewport.redraw(bpy.context)

    def _schedule(self) -> None:
        """Have it looked up when nothing has changed for a while. A timer that waits already waits longer: Blender
        keeps those that are taken back until it next runs any, which without a window is never.
        """
        self._changed = time.monotonic()
        if not bpy.app.timers.is_registered(self._timer):
            bpy.app.timers.register(self._timer, first_interval=_REST)

    def _look_up_at_rest(self) -> float | None:
        """Look up what has been asked for, or return in how many seconds to try again."""
        left = self._changed + _REST - time.monotonic()
        if left > 0:
            return left
        self.look_up()
        return None


def known_changes() -> ChangeCache:
    """Return what is known of changes in this session."""
    return SESSION.of(ChangeCache)


def _matters(update: bpy.types.DepsgraphUpdate) -> bool:
    """Whether an update can change what is tracked: no other bones are selected, and no pose is shown."""
    if isinstance(update.id, bpy.types.Object):
        return bool(update.is_updated_transform)
    return isinstance(update.id, _WATCHED_TYPES) or (
        isinstance(update.id, _GEOMETRY_TYPES) and update.is_updated_geometry
    )


@bpy.app.handlers.persistent
def _changed(_scene: bpy.types.Scene, depsgraph: bpy.types.Depsgraph) -> None:
    if any(_matters(update) for update in depsgraph.updates):
        known_changes().outdate()


@bpy.app.handlers.persistent
def _replaced(*_arguments: object) -> None:
    known_changes().outdate()


def register() -> None:
    """Watch for changes."""
    watch(_changed, _replaced)
