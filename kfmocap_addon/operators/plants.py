"""Plants: when heel and ball of the feet stand on the ground, and feet that keep to it."""

from __future__ import annotations

import bpy

from ..scene_io import active_performer
from .conditions import Conditional, has_performer
from .reporting import reported

POINTS = ("heel.L", "ball.L", "heel.R", "ball.R")


class FindPlants(Conditional, bpy.types.Operator):
    """Find when heel and ball of the performer's feet stand on the ground. What you have set stays. Tracking does this
    by itself; do it again after you have changed the curves"""

    bl_idname = "kfmocap.find_plants"
    bl_label = "Find Plants"
    conditions = (has_performer,)

    def execute(self, context: bpy.types.Context) -> set[str]:
        from ..retargeting import sole_plants

        with reported(self) as outcome:
            slot = active_performer.chosen(context)
            sole_plants.find(context.scene, slot)
            self.report({"INFO"}, f"{slot.name}: {len(slot.plants)} plants of heels and balls")
        return outcome.value


class SetPlant(Conditional, bpy.types.Operator):
    """Say on which frames a point of a foot stands on the ground, or does not. With a preview range in the timeline (P)
    it is that range"""

    bl_idname = "kfmocap.set_plant"
    bl_label = "Set Plant"
    conditions = (has_performer,)

    point: bpy.props.EnumProperty(
        items=[
            ("heel.L", "Left Heel", ""),
            ("ball.L", "Left Ball", ""),
            ("heel.R", "Right Heel", ""),
            ("ball.R", "Right Ball", ""),
            ("L", "Left Foot", "Heel and ball"),
            ("R", "Right Foot", "Heel and ball"),
        ],
        name="Point",
        description="Which point of the foot",
    )
    planted: bpy.props.BoolProperty(default=True, name="Planted", description="It stands on the ground, or does not")
    first: bpy.props.IntProperty(name="First", description="First scene frame")
    last: bpy.props.IntProperty(name="Last", description="Last scene frame")

    @classmethod
    def description(cls, _context: bpy.types.Context, properties: bpy.types.OperatorProperties) -> str:
        what = "stands on the ground" if properties.planted else "does not stand on the ground"
        return f"Say on which frames this point {what}: the preview range of the timeline (P), else frames you enter"

    def invoke(self, context: bpy.types.Context, _event: bpy.types.Event) -> set[str]:
        scene = context.scene
        if scene.use_preview_range:
            self.first, self.last = scene.frame_preview_start, scene.frame_preview_end
            return self.execute(context)
        self.first = self.last = scene.frame_current
        return set(context.window_manager.invoke_props_dialog(self))

    def execute(self, context: bpy.types.Context) -> set[str]:
        from ..retargeting import sole_plants

        with reported(self) as outcome:
            points = [name for name in POINTS if name == self.point or name[-1] == self.point]
            slot = active_performer.chosen(context)
            sole_plants.edit(context.scene, slot, points, (self.first, self.last), self.planted)
        return outcome.value


class ForgetPlantEdits(Conditional, bpy.types.Operator):
    """Forget what you have set about plants, and find them anew"""

    bl_idname = "kfmocap.forget_plant_edits"
    bl_label = "Forget Edits"
    conditions = (has_performer,)

    def execute(self, context: bpy.types.Context) -> set[str]:
        from ..retargeting import sole_plants

        with reported(self) as outcome:
            slot = active_performer.chosen(context)
            slot.plant_edits.clear()
            sole_plants.find(context.scene, slot)
        return outcome.value


class CleanFeet(Conditional, bpy.types.Operator):
    """Make planted feet of the tracked motion stand still, flat on the ground where heel and ball are planted. Your own
    keys stay; tracking again brings the motion back as it was"""

    bl_idname = "kfmocap.clean_feet"
    bl_label = "Clean Feet"
    conditions = (has_performer,)

    def execute(self, context: bpy.types.Context) -> set[str]:
        from ..retargeting import sole_plants

        with reported(self) as outcome:
            slot = active_performer.chosen(context)
            sole_plants.clean_feet(context.scene, slot)
            self.report({"INFO"}, f"{slot.name}: feet stand still during {len(slot.plants)} plants")
        return outcome.value


CLASSES = (FindPlants, SetPlant, ForgetPlantEdits, CleanFeet)
