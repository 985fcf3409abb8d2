"""Motion that is being tracked, shown in a scene while it comes in.

It is written into copies of the performers' actions. The actions themselves are not touched, so that taking the preview
away leaves the scene as it was. A file that is saved meanwhile, by a script or another add-on, holds the scene without
the preview: while it shows, nobody uses the performers' own actions, and Blender saves none that nobody uses.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import bpy

from ....core.body.motion import Motion
from ..body import shown_pose
from . import motion_curves


@dataclass(frozen=True)
class _Lent:
    """An armature that shows a copy of its action, and what it showed before.

    Attributes
    ----------
    armature : bpy.types.Object
    action : bpy.types.Action
        Its own.
    slot : int
        Which of the action's slots is the armature's.
    copy : bpy.types.Action
    """

    armature: bpy.types.Object
    action: bpy.types.Action
    slot: int
    copy: bpy.types.Action


class TrackingPreview:
    """Shows the frames of a scene's shot that are tracked so far.

    Parameters
    ----------
    scene : bpy.types.Scene
    slots : mapping of int to KFMocapPerformer
        Whose motion is shown, by their numbers among the performers that are tracked. Each has an action: it has key
        poses.
    """

    def __init__(self, scene: bpy.types.Scene, slots: Mapping[int, bpy.types.PropertyGroup]) -> None:
        self._scene, self._frame = scene, scene.frame_current
        self._numbers, self._armatures = list(slots), [slot.armature for slot in slots.values()]
        self._poses = [shown_pose.shown_values(armature) for armature in self._armatures]
        self._lent = [_lend(armature) for armature in self._armatures]
        self._is_moved = False
        self._segments: dict[tuple[int, int], tuple[Motion, ...]] = {}
        for handlers, handler in self._handlers():
            handlers.append(handler)

    def show(self, segments: Mapping[tuple[int, int], tuple[Motion, ...]]) -> None:
        """Show motions of segments, by their first and last shot frames, in place of those shown before."""
        self._segments.update(segments)
        start = self._scene.kfmocap.frame_start
        for (first, _), motions in segments.items():
            for number, lent in zip(self._numbers, self._lent, strict=True):
                if lent is not None:
                    motion_curves.write_motion(lent.armature, motions[number], start + first)
        self._is_moved = self._is_moved or self._scene.frame_current != self._frame
        self._redraw()

    def end(self) -> None:
        """Remove the preview, and show what was shown before."""
        for handlers, handler in self._handlers():
            with contextlib.suppress(ValueError):  # a file was opened, and Blender has let go of it
                handlers.remove(handler)
        self._take_away()

    def _handlers(self) -> list[tuple[list[Any], Callable[..., None]]]:
        handlers = bpy.app.handlers
        before, after = [handlers.save_pre], (handlers.save_post, handlers.save_post_fail)
        if hasattr(handlers, "exit_pre"):  # from 5.1 on; Blender then saves for Recover Last Session
            before.append(handlers.exit_pre)
        return [*((kind, self._take_away) for kind in before), *((kind, self._after_saving) for kind in after)]

    def _after_saving(self, *_: object) -> None:
        with contextlib.suppress(ReferenceError):
            self._lent = [_lend(armature) for armature in self._armatures]
            self.show(self._segments)

    def _take_away(self, *_: object) -> None:
        with contextlib.suppress(ReferenceError):  # the file was closed, and all of it is gone anyway
            for lent in self._lent:
                if lent is not None:
                    _take_back(lent)
            self._lent = []
            self._redraw()
            for armature, values in zip(self._armatures, self._poses, strict=True):
                shown_pose.show_values(armature, values)  # of what is not keyed, the animation knows nothing
            if self._is_moved or self._scene.frame_current != self._frame:
                self._redraw()

    def _redraw(self) -> None:
        self._scene.frame_set(self._scene.frame_current, subframe=self._scene.frame_subframe)


def _lend(armature: bpy.types.Object) -> _Lent | None:
    """Assign a copy of its action to an armature; None if it has no action of its own."""
    data = armature.animation_data
    if data is None or data.action is None or data.use_tweak_mode:
        return None
    action, slot = data.action, list(data.action.slots).index(data.action_slot)
    copy = action.copy()
    _assign(data, copy, slot)
    return _Lent(armature, action, slot, copy)


def _take_back(lent: _Lent) -> None:
    _assign(lent.armature.animation_data, lent.action, lent.slot)
    bpy.data.actions.remove(lent.copy)


def _assign(data: bpy.types.AnimData, action: bpy.types.Action, slot: int) -> None:
    data.action = action
    data.action_slot = action.slots[slot]
