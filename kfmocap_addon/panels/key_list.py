"""What the panel lists as key poses: looked up beside the drawing, when keys have changed."""

from __future__ import annotations

from dataclasses import dataclass

import bpy

from ..viewports import viewport

_DELAY = 0.05
_found: dict[int, tuple[Row, ...]] = {}  # by the armature's number of this session
_current: set[int] = set()  # those that are as the keys are now


@dataclass(frozen=True)
class Row:
    """A frame with a key pose.

    Attributes
    ----------
    frame : int
        Scene frame.
    bones : tuple of str
        The bones that are keyed; empty for the whole body.
    proposed : bool
        It is the tracker's proposal.
    """

    frame: int
    bones: tuple[str, ...] = ()
    proposed: bool = False

    def told(self) -> str:
        """What is posed there, for people."""
        if self.proposed:
            return "Go to this frame: a proposed key pose, which the tracker may still move"
        return f"Go to this frame: a key pose of {', '.join(self.bones) if self.bones else 'the whole body'}"


def rows(armature: bpy.types.Object) -> tuple[Row, ...] | None:
    """The key poses of an armature; as they were until they have been looked up anew, None before the first time."""
    if armature.session_uid not in _current:
        _schedule()
    return _found.get(armature.session_uid)


def looked_up(armature: bpy.types.Object) -> tuple[Row, ...]:
    """The key poses of an armature, now; none where it is no body of ours."""
    from ...core.errors import KFMocapError
    from ..scene_io import body_armature, keyframes

    try:
        keyed, proposed = keyframes.keyed_bones(armature)
    except KFMocapError:
        return ()
    whole = {bone.name for bone in body_armature.body_bones(armature)}
    found = [Row(frame, () if bones == whole else tuple(sorted(bones))) for frame, bones in keyed.items()]
    return tuple(sorted(found + [Row(frame, (), True) for frame in proposed], key=lambda row: row.frame))


def _schedule() -> None:
    if not bpy.app.timers.is_registered(_look_up):
        bpy.app.timers.register(_look_up, first_interval=_DELAY)


def _look_up() -> None:
    for scene in bpy.data.scenes:
        for slot in scene.kfmocap.performers:
            if slot.armature is not None and slot.armature.session_uid not in _current:
                _found[slot.armature.session_uid] = looked_up(slot.armature)
                _current.add(slot.armature.session_uid)
    viewport.redraw(bpy.context)


@bpy.app.handlers.persistent
def _changed(_scene: bpy.types.Scene, depsgraph: bpy.types.Depsgraph) -> None:
    if any(isinstance(update.id, bpy.types.Action) for update in depsgraph.updates):
        _outdated()


@bpy.app.handlers.persistent
def _replaced(*_arguments: object) -> None:
    _outdated()


def _outdated() -> None:
    """Have what was drawn before looked up anew."""
    _current.clear()
    if _found:
        _schedule()


def register() -> None:
    bpy.app.handlers.depsgraph_update_post.append(_changed)
    for handlers in (bpy.app.handlers.undo_post, bpy.app.handlers.redo_post, bpy.app.handlers.load_post):
        handlers.append(_replaced)


def unregister() -> None:
    bpy.app.handlers.depsgraph_update_post.remove(_changed)
    for handlers in (bpy.app.handlers.undo_post, bpy.app.handlers.redo_post, bpy.app.handlers.load_post):
        handlers.remove(_replaced)
    if bpy.app.timers.is_registered(_look_up):
        bpy.app.timers.unregister(_look_up)
    _found.clear()
    _current.clear()
