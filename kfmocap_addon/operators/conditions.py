"""When an operator can be used: the tooltip of its disabled button says what is missing."""

from collections.abc import Callable
from typing import Any

import bpy

from ...core.errors import ShotError
from ..scene_io import active_performer, playback
from .mixin import ReportingOperator

Condition = Callable[[bpy.types.Context], str]
"""Returns what is missing, as a sentence for the user, or an empty string if the condition holds."""


class Conditional(ReportingOperator):
    """An operator that can be used if all of its conditions hold. Unless it says otherwise, it can be undone.

    Attributes
    ----------
    conditions : tuple of Condition
    while_placing : bool
        Whether it can also be used while joints are being placed, because it changes neither poses nor keys.
    """

    bl_options: set[Any] = {"REGISTER", "UNDO"}
    conditions: tuple[Condition, ...] = ()
    while_placing = False

    @classmethod
    def missing(cls, context: bpy.types.Context) -> str:
        """Return what is missing, as a sentence for the user; empty if the operator can be used."""
        always = (_scene_can_be_changed,) if cls.while_placing else (_scene_can_be_changed, _no_joints_being_placed)
        conditions = (*always, *cls.conditions)
        return next(filter(None, (condition(context) for condition in conditions)), "")

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Check whether the operator can be used; if not, the disabled button's tooltip says why."""
        missing = cls.missing(context)
        if missing:
            cls.poll_message_set(missing)
        return not missing


def is_placing(context: bpy.types.Context) -> bool:
    """Whether joints are being placed in the window: its frame has marks that are neither keyed nor discarded yet.

    Blender lists None for a tool whose add-on was disabled while it ran, until the window has its next event.
    """
    running = context.window.modal_operators if context.window is not None else ()
    return any(tool is not None and tool.bl_idname == "KFMOCAP_OT_place_joints" for tool in running)


def _scene_can_be_changed(context: bpy.types.Context) -> str:
    library = context.scene.library
    return f"This scene is linked from {bpy.path.basename(library.filepath)}: open that file instead" if library else ""


def _no_joints_being_placed(context: bpy.types.Context) -> str:
    return "End Place Joints first: Enter keys the pose, Esc cancels" if is_placing(context) else ""


def has_views(context: bpy.types.Context) -> str:
    """The shot has views."""
    return "" if context.scene.kfmocap.views else "There is no footage yet: use Add Footage or Load Shot"


def has_shot(context: bpy.types.Context) -> str:
    """The scene has views with calibrated cameras, and a performer."""
    shot = context.scene.kfmocap
    if not shot.views:
        return has_views(context)
    unknown = next((view.name for view in shot.views if not view.is_calibrated), None)
    if unknown is not None:
        return f"The camera of the view '{unknown}' is not calibrated: use Import Calibration, or Calibrate"
    if not shot.performers:
        return "There is nobody to track yet: use Add Body"
    gone = next((slot for slot in shot.performers if not active_performer.is_present(context.scene, slot)), None)
    return _not_played(context.scene) if gone is None else _is_gone(gone)


def _not_played(scene: bpy.types.Scene) -> str:
    """Return why keys are not played on their frames, with a capital letter."""
    try:
        playback.check_playback(scene)
    except ShotError as error:
        text = str(error)
        return text[0].upper() + text[1:]
    return ""


def _is_gone(slot: bpy.types.PropertyGroup) -> str:
    return f"The body of {slot.name} is gone from the scene: bring it back under Body, or remove it"


def has_footage(context: bpy.types.Context) -> str:
    """Every view has its footage, which was there when the file was opened."""
    for view in context.scene.kfmocap.views:
        if not view.has_camera:
            back = "bring it back under Footage and Cameras, or " if view.can_be_restored else ""
            return f"The camera of {view.name} is gone from the scene: {back}remove the view, and add its footage anew"
        if view.missing:
            return f"The footage of {view.name} is missing: use Relink"
        if not any(behind.source == "MOVIE_CLIP" and behind.clip for behind in view.camera.data.background_images):
            todo = "choose its clip under Background Images of the camera, or remove the view and add its footage anew"
            return f"The camera of {view.name} has no footage behind it: {todo}"
    return ""


def looks_through_view(context: bpy.types.Context) -> str:
    """The scene's camera is that of a view."""
    return "" if context.scene.kfmocap.shown_view >= 0 else "Look through one of the views first"


def has_keypoints(context: bpy.types.Context) -> str:
    """Some view has 2D keypoints."""
    known = any(view.keypoints for view in context.scene.kfmocap.views)
    return "" if known else "No view has 2D keypoints yet: use Import Keypoints"


def has_performer(context: bpy.types.Context) -> str:
    """There is a performer that can be posed."""
    slot = active_performer.chosen(context)
    if slot is None:
        return no_performer(context)
    if slot.armature.mode == "EDIT":
        return "The body is being edited: leave edit mode first"
    if playback.unreachable_keys(slot.armature):
        return pushed_down(slot)
    return _not_played(context.scene)


def pushed_down(slot: bpy.types.PropertyGroup) -> str:
    """Return why a performer whose keys are in the NLA alone is neither posed nor tracked."""
    todo = "choose it again, or a new one, in the Action Editor"
    return f"The action of {slot.name} was pushed down into the NLA: {todo}"


def no_performer(context: bpy.types.Context) -> str:
    """Say why there is nobody in the scene."""
    slots = context.scene.kfmocap.performers
    return _is_gone(slots[0]) if slots else "This scene has no performer yet: use Load Shot, or add a body"


def on_whole_frame(context: bpy.types.Context) -> str:
    """The pose that is shown is that of a frame, and none between two."""
    return "Go to a whole frame first: there is no picture between two frames" if context.scene.frame_subframe else ""


def has_tracked(context: bpy.types.Context) -> str:
    """The tracker has written keys of some performer."""
    from ..scene_io.keys import tracked_keys

    written = any(tracked_keys.is_recorded(slot.armature) for slot in context.scene.kfmocap.performers)
    return "" if written else "Nothing is tracked yet: use Track All"


def in_object_mode(context: bpy.types.Context) -> str:
    """Objects can be added."""
    return "" if context.mode == "OBJECT" else "Go to object mode first"


def has_motion(context: bpy.types.Context) -> str:
    """The chosen performer is animated."""
    slot = active_performer.chosen(context)
    data = slot.armature.animation_data if slot is not None else None
    return "" if data is not None and data.action is not None else "There is no motion yet: set key poses, or track"


def frame_is_in_shot(first: int = 0, last: int = 0) -> Condition:
    """Return the condition that the current frame is between the shot's first + `first` and its last + `last`."""

    def condition(context: bpy.types.Context) -> str:
        frame, length = shot_frame(context.scene), context.scene.kfmocap.length
        if first <= frame < length + last:
            return ""
        side = "before" if frame < first else "after"
        return outside_shot(context.scene, context.scene.frame_current) or f"The shot has no frame {side} this one"

    return condition


def outside_shot(scene: bpy.types.Scene, frame: int) -> str:
    """Return a message that a frame of the scene is not one of the shot's; empty if it is, or there is no footage."""
    start, length = scene.kfmocap.frame_start, scene.kfmocap.length
    if not scene.kfmocap.views or start <= frame < start + length:
        return ""
    return f"Frame {frame} is not one of the shot's, which are {start} to {start + length - 1}"


def shot_frame(scene: bpy.types.Scene) -> int:
    """Return the frame of the shot that the scene shows."""
    return scene.frame_current - scene.kfmocap.frame_start
