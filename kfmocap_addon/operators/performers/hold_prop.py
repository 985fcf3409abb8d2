"""Props in hands: which bone holds which prop on which frames."""

from __future__ import annotations

import bpy

from ....core.errors import ShotError
from ...scene_io import active_performer
from ..conditions import Conditional, has_performer


def _has_two(context: bpy.types.Context) -> str:
    enough = len(active_performer.present(context.scene)) > 1
    return "" if enough else "A performer and a prop are needed: select the prop, and Use Active Object"


def _has_holds(context: bpy.types.Context) -> str:
    return "" if context.scene.kfmocap.holds else "No prop is held"


class HoldProp(Conditional, bpy.types.Operator):
    """Let a performer hold a prop from this scene frame to the end of the shot, or in the preview range of the timeline
    (P). While it is held, the prop stays in the hand as key poses of both show it, so at least one frame of the range
    needs a key pose of both. The bone and the frames can be changed in the list"""

    bl_idname = "kfmocap.hold_prop"
    bl_label = "Hold Prop"
    conditions = (has_performer, _has_two)

    def act(self, context: bpy.types.Context) -> None:
        from ...scene_io import prop_holds

        scene = context.scene
        prop, holder = _prop_and_holder(context)
        bone = prop_holds.bone_at(prop, holder)
        last = scene.kfmocap.frame_start + scene.kfmocap.length - 1
        frames = (min(scene.frame_current, last), last)
        if scene.use_preview_range:
            frames = (scene.frame_preview_start, scene.frame_preview_end)
        prop_holds.add_hold(scene, prop, holder, bone, frames)
        self.report({"INFO"}, f"{holder.name} holds {prop.name} with {bone} on frames {frames[0]} to {frames[1]}")


def _prop_and_holder(context: bpy.types.Context) -> tuple[bpy.types.PropertyGroup, bpy.types.PropertyGroup]:
    """Return the prop and its holder: the chosen performer is one of the two, and the prop has fewer bones."""
    chosen = active_performer.chosen(context)
    slots = sorted(active_performer.present(context.scene), key=lambda slot: len(slot.armature.data.bones))
    others = [slot for slot in slots if slot != chosen]
    is_prop = len(chosen.armature.data.bones) < len(others[-1].armature.data.bones)
    return (chosen, others[-1]) if is_prop else (others[0], chosen)


class RemoveHold(Conditional, bpy.types.Operator):
    """Remove this from the list: the prop is no longer held on these frames"""

    bl_idname = "kfmocap.remove_hold"
    bl_label = "Remove Hold"
    conditions = (_has_holds,)

    number: bpy.props.IntProperty(min=0, name="Number", description="Which of the list, from 0")

    def act(self, context: bpy.types.Context) -> None:
        holds = context.scene.kfmocap.holds
        if self.number >= len(holds):
            raise ShotError(f"There is no number {self.number} in the list: it has {len(holds)}, counted from 0")
        holds.remove(self.number)


CLASSES = (HoldProp, RemoveHold)
