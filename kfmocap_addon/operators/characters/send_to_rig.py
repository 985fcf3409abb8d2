"""Send to Rig: the motion of a performer on another character."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import bpy

from ...properties.pointer_polls import chosen_character
from ...scene_io import active_performer
from ..conditions import Conditional, has_performer

if TYPE_CHECKING:
    from ...retargeting.send import SendOptions


def has_source(context: bpy.types.Context) -> str:
    """There is a motion to send: another armature's, or a performer's."""
    return "" if context.scene.kfmocap.retarget.source is not None else has_performer(context)


def is_followed_live(context: bpy.types.Context) -> str:
    """A character is chosen that follows a motion live."""
    target = context.scene.kfmocap.retarget.target
    if target is not None:
        from ...retargeting.live import is_following  # loads NumPy, which must not slow down Blender's start

        if is_following(target):
            return ""
    return "The character does not follow a motion live"


def was_sent_motion(context: bpy.types.Context) -> str:
    """A character is chosen whose action is motion that was sent to it."""
    target = context.scene.kfmocap.retarget.target
    if target is not None:
        from ...retargeting.live import is_following
        from ...retargeting.sent_actions import was_sent

        if is_following(target):
            return "The character follows a motion live: use Stop Following first"
        if was_sent(target):
            return ""
    return "The character's action is no motion that was sent to it"


def has_target(context: bpy.types.Context) -> str:
    """A character is chosen, or is the only other armature, that is not the source itself."""
    settings = context.scene.kfmocap.retarget
    target = chosen_character(context.scene)
    if target is None:
        return "Choose the character's armature first"
    if target == (settings.source or active_performer.chosen(context).armature):
        return "The character moves already: choose another armature"
    return "The character is in edit mode: leave it first" if target.mode == "EDIT" else ""


class SendToRig(Conditional, bpy.types.Operator):
    """Put the performer's motion, or another armature's, on the chosen character, as a new action on its rig's
    controls. The action that it has now stays in the file"""

    bl_idname = "kfmocap.send_to_rig"
    bl_label = "Send to Rig"
    conditions = (has_source, has_target)

    def act(self, context: bpy.types.Context) -> None:
        from ....core.retargeting.bone_roles.roles import named_together
        from ...retargeting import send, sole_plants, source_motion
        from ...retargeting.live import LiveSource
        from ...retargeting.rigs.overrides import editable
        from ...retargeting.shown_characters import show_in

        slot, scene = active_performer.chosen(context), context.scene
        settings, first = scene.kfmocap.retarget, scene.kfmocap.frame_start
        options = _options(settings)
        if settings.source is None:
            motion = source_motion.motion_of_performer(scene, slot)
            live = LiveSource(slot.armature, {})
            options = replace(options, planted=sole_plants.on_ground(scene, slot))
        else:
            first = scene.frame_start
            motion, bones = source_motion.motion_of_armature(scene, settings.source, (first, scene.frame_end))
            options = replace(options, source_bones=bones)
            live = LiveSource(settings.source, source_motion.shown_bones(settings.source, bones))
        if settings.live:
            options = replace(options, live=live)
        target = editable(chosen_character(scene), scene)
        elsewhere = show_in(scene, target)
        report = send.send_to_rig(scene, motion, target, first, options)
        settings.target = target
        _show(self, settings, report["error"])
        if elsewhere:
            self.report({"INFO"}, f"{target.name} was in another scene only: it is shown in this one, too")
        if report["not_in_target"]:
            lacking = named_together(report["not_in_target"])
            self.report({"INFO"}, f"{target.name} has no {lacking}: that motion is left out")
        for text in report["warnings"]:
            self.report({"WARNING"}, text)


class StopFollowing(Conditional, bpy.types.Operator):
    """The character no longer follows the motion live: its constraints and settings are as they were before"""

    bl_idname = "kfmocap.stop_following"
    bl_label = "Stop Following"
    conditions = (is_followed_live,)

    def act(self, context: bpy.types.Context) -> None:
        from ...retargeting import live

        live.stop_following(context.scene.kfmocap.retarget.target)


class TakeMotionBack(Conditional, bpy.types.Operator):
    """The character gets back the action, the pose and the settings of its rig that it had before the motion was sent
    to it. Changes to the motion since then are lost"""

    bl_idname = "kfmocap.take_motion_back"
    bl_label = "Take Motion Back"
    conditions = (was_sent_motion,)

    def act(self, context: bpy.types.Context) -> None:
        from ...retargeting import sent_actions

        target = context.scene.kfmocap.retarget.target
        sent_actions.take_back(target)
        context.scene.kfmocap.retarget.errors.clear()
        data = target.animation_data
        now = f"has its action '{data.action.name}' again" if data.action is not None else "has no action, as before"
        self.report({"INFO"}, f"{target.name} {now}")


def _options(settings: bpy.types.PropertyGroup) -> SendOptions:
    """Return the options chosen in the panel."""
    from ....core.retargeting.transfer import RetargetOptions
    from ...retargeting.listed_bones import listed_map
    from ...retargeting.rigs.rig_curves import CurveOptions
    from ...retargeting.send import SendOptions

    sparse = (settings.angle, settings.distance / 1000) if settings.sparse else (0.0, 0.0)
    return SendOptions(
        None if settings.preset == "auto" else settings.preset,
        listed_map(settings),
        retarget=RetargetOptions(settings.root, settings.feet, settings.hands),
        curves=CurveOptions(settings.layer, *sparse),
    )


def _show(operator: bpy.types.Operator, settings: bpy.types.PropertyGroup, errors: dict[str, dict[str, float]]) -> None:
    """Store the remaining errors for the panel, and report the largest."""
    settings.errors.clear()
    for limb, error in errors.items():
        row = settings.errors.add()
        row.name, row.degrees, row.distance = limb, error["worst_degrees"], error["worst_mm"]
    worst = max((error["worst_degrees"] for error in errors.values()), default=0.0)
    operator.report({"INFO"}, f"{settings.target.name} moves; its bones are at most {worst:.2f} degrees off")


CLASSES = (SendToRig, StopFollowing, TakeMotionBack)
