"""Send to Rig: the motion of a performer on another character."""

from __future__ import annotations

from typing import TYPE_CHECKING

import bpy

from ..scene_io import active_performer
from .conditions import Conditional, has_performer
from .reporting import reported

if TYPE_CHECKING:
    from ..retargeting.send import SendOptions


def has_target(context: bpy.types.Context) -> str:
    """A character is chosen that is no performer itself."""
    target = context.scene.kfmocap.retarget.target
    if target is None:
        return "Choose the character's armature first"
    if target == active_performer.chosen(context).armature:
        return "The character is the performer itself: choose another armature"
    return "The character is in edit mode: leave it first" if target.mode == "EDIT" else ""


class SendToRig(Conditional, bpy.types.Operator):
    """Put the performer's motion on the chosen character, as a new action on its rig's controls. The action that it has
    now stays in the file"""

    bl_idname = "kfmocap.send_to_rig"
    bl_label = "Send to Rig"
    bl_options = {"REGISTER", "UNDO"}
    conditions = (has_performer, has_target)

    def execute(self, context: bpy.types.Context) -> set[str]:
        from ..retargeting import performer_motion, send
        from ..retargeting.overrides import editable

        with reported(self) as outcome:
            slot, scene = active_performer.chosen(context), context.scene
            settings = scene.kfmocap.retarget
            motion = performer_motion.motion_of_performer(scene, slot)
            options = _options(settings)
            target = editable(settings.target, scene)
            report = send.send_to_rig(scene, motion, target, scene.kfmocap.frame_start, options)
            settings.target = target
            _show(self, settings, report["error"])
            for text in report["warnings"]:
                self.report({"WARNING"}, text)
        return outcome.value


def _options(settings: bpy.types.PropertyGroup) -> SendOptions:
    """What the panel says."""
    from ...core.retargeting.transfer import RetargetOptions
    from ..retargeting.listed_bones import listed_map
    from ..retargeting.rig_curves import CurveOptions
    from ..retargeting.send import SendOptions

    sparse = (settings.angle, settings.distance / 1000) if settings.sparse else (0.0, 0.0)
    return SendOptions(
        None if settings.preset == "auto" else settings.preset,
        listed_map(settings),
        retarget=RetargetOptions(settings.root, settings.feet, settings.hands),
        curves=CurveOptions(settings.layer, *sparse),
    )


def _show(operator: bpy.types.Operator, settings: bpy.types.PropertyGroup, errors: dict[str, dict[str, float]]) -> None:
    """Keep what is left of errors for the panel, and say the worst."""
    settings.errors.clear()
    for limb, error in errors.items():
        row = settings.errors.add()
        row.name, row.degrees, row.distance = limb, error["worst_degrees"], error["worst_mm"]
    worst = max((error["worst_degrees"] for error in errors.values()), default=0.0)
    operator.report({"INFO"}, f"{settings.target.name} moves; its bones are at most {worst:.2f} degrees off")


CLASSES = (SendToRig,)
