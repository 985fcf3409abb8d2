"""Plants: finding and editing when heel and ball stand on the ground, and cleaning up feet accordingly."""

from __future__ import annotations

import bpy

from ...scene_io import active_performer
from ...viewports import viewport
from ..conditions import Conditional, has_motion, has_performer


class PlantOperator(Conditional):
    """An operator on the plants of the active performer."""

    conditions = (has_performer, has_motion)

    def act(self, context: bpy.types.Context) -> None:
        """Make the change, and report its result."""
        slot = active_performer.chosen(context)
        if message := self.change(context.scene, slot):
            self.report({"INFO"}, f"{slot.name}: {message}")
        viewport.redraw(context)  # after a dialog Blender does not

    def change(self, scene: bpy.types.Scene, slot: bpy.types.PropertyGroup) -> str:
        """Make the change; returns a message for the user."""
        raise NotImplementedError


class _FindingAnew(PlantOperator):
    """An operator that empties one of the performer's lists, and finds the plants anew.

    Attributes
    ----------
    emptied : str
        Name of that list.
    """

    emptied = ""

    def change(self, scene: bpy.types.Scene, slot: bpy.types.PropertyGroup) -> str:
        from ...retargeting import sole_plants

        getattr(slot, self.emptied).clear()
        sole_plants.find(scene, slot)
        return f"{len(slot.plants)} plants of heels and balls"


class FindPlants(_FindingAnew, bpy.types.Operator):
    """Find when heel and ball of the performer's feet seem to stand in the motion as it is now: for curves that you
    changed after tracking, or to see also where the footage showed them creep. What you have set here stays"""

    bl_idname = "kfmocap.find_plants"
    bl_label = "Find Plants"
    emptied = "tested_plants"


class SetPlant(PlantOperator, bpy.types.Operator):
    """Set on which frames a point of a foot stands on the ground, or does not: in the preview range of the timeline
    (P), if there is one"""

    bl_idname = "kfmocap.set_plant"
    bl_label = "Set Plant"

    point: bpy.props.EnumProperty(
        items=[
            ("heel.L", "Left Heel", "The heel alone"),
            ("ball.L", "Left Ball", "The ball of the foot alone"),
            ("heel.R", "Right Heel", "The heel alone"),
            ("ball.R", "Right Ball", "The ball of the foot alone"),
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
        self.first, self.last = self._suggested(context)
        return set(context.window_manager.invoke_props_dialog(self))

    def _suggested(self, context: bpy.types.Context) -> tuple[int, int]:
        """Return the frames to offer: those of the plant on this frame, if it is to be removed, else this frame."""
        shown = context.scene.frame_current
        if not self.planted:
            for plant in active_performer.chosen(context).plants:
                if plant.name == self.point and plant.first <= shown <= plant.last:
                    return plant.first, plant.last
        return shown, shown

    def change(self, scene: bpy.types.Scene, slot: bpy.types.PropertyGroup) -> str:
        from ....core.body.soles import SOLE_POINTS
        from ...retargeting import sole_plants
        from ...scene_io.review import plant_lists

        if not slot.plants_found:
            sole_plants.find(scene, slot)
        points = [name for name in SOLE_POINTS if self.point in (name, name[-1])]
        plant_lists.edit(scene, slot, points, (self.first, self.last), self.planted)
        what = f"{' and '.join(points)} {'stand' if self.planted else 'do not stand'}"
        if len(points) == 1:
            what = f"{points[0]} {'stands' if self.planted else 'does not stand'}"
        frames = f"frame {self.first}" if self.first == self.last else f"frames {self.first} to {self.last}"
        return f"{what} on the ground on {frames}"


class ForgetPlantEdits(_FindingAnew, bpy.types.Operator):
    """Discard your corrections of the plants"""

    bl_idname = "kfmocap.forget_plant_edits"
    bl_label = "Forget Edits"
    emptied = "plant_edits"


class CleanFeet(PlantOperator, bpy.types.Operator):
    """Make planted feet of the tracked motion stand still, flat on the ground where heel and ball are planted. Your own
    keys stay; tracking again brings the motion back as it was"""

    bl_idname = "kfmocap.clean_feet"
    bl_label = "Clean Feet"

    def change(self, scene: bpy.types.Scene, slot: bpy.types.PropertyGroup) -> str:
        from ...retargeting import sole_plants

        sole_plants.clean_feet(scene, slot)
        return f"feet stand still during {len(slot.plants)} plants"


CLASSES = (FindPlants, SetPlant, ForgetPlantEdits, CleanFeet)
