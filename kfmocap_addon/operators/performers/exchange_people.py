"""Exchange People: swapping two performers among the people in the keypoints."""

import bpy

from ....core.errors import ShotError
from ...scene_io import active_performer
from ..conditions import Conditional, has_performer


def _has_two(context: bpy.types.Context) -> str:
    return "" if len(context.scene.kfmocap.performers) > 1 else "There is one performer only: nobody to exchange with"


class ExchangePeople(Conditional, bpy.types.Operator):
    """Swap the people that the chosen performer and another performer are in the keypoints. Pose or track both again
    afterwards"""

    bl_idname = "kfmocap.exchange_people"
    bl_label = "Exchange People"
    conditions = (has_performer, _has_two)

    other: bpy.props.StringProperty(name="With", description="The other performer; by default the next one")

    def act(self, context: bpy.types.Context) -> None:
        from ...scene_io import identities

        slots = context.scene.kfmocap.performers
        number = slots.find(active_performer.chosen(context).name)
        other = slots.find(self.other) if self.other else (number + 1) % len(slots)
        if other in (-1, number):
            raise ShotError(f"'{self.other}' is no other performer: name one of the others of the shot")
        identities.exchange_people(context.scene, slots[number], slots[other])
        changed = ", ".join(f"{slots[i].name} is person {slots[i].person}" for i in (number, other))
        self.report({"INFO"}, f"{changed}: pose or track them anew")


CLASSES = (ExchangePeople,)
