"""The section "Review": how far to trust what was tracked, and where a key pose would help."""

import bpy

from ..operators.tracking.go_to_frame import GoToFrame
from ..operators.tracking.plants import CleanFeet, FindPlants, ForgetPlantEdits, SetPlant
from ..operators.tracking.show_residual import HideResidual, ShowResidual
from ..scene_io import active_performer
from ..scene_io.review import bone_visibility
from . import performer_rows
from .section import Section
from .texts import draw_text


class ReviewPanel(Section, bpy.types.Panel):
    bl_idname = "KFMOCAP_PT_review"
    bl_label = "Review"

    def draw_content(self, context: bpy.types.Context) -> None:
        layout, properties = self.layout, context.scene.kfmocap
        tracked = [s for s in performer_rows.in_order(context) if bone_visibility.is_tracked(s.armature)]
        if not tracked:
            layout.label(text="Not tracked yet: use Track All", icon="INFO")
            return
        row = layout.row(align=True)
        row.prop(properties, "show_confidence", toggle=True, icon="COLOR")
        row.prop(properties, "confidence_limit", text="Red at mm")
        row = layout.row(align=True)
        row.operator(ShowResidual.bl_idname, icon="IMAGE_BACKGROUND")
        row.operator(HideResidual.bl_idname, text="", icon="X")
        for slot in tracked:
            performer_rows.draw_title(layout, context, slot)
            column = layout.column(align=True)
            _draw_hidden(column, slot)
            _draw_lost(column, context, slot)
            _draw_helpful(column, slot)
            _draw_suggestions(column, slot)
        if active_performer.chosen(context) in tracked:
            _draw_plants(layout.column(), context)


def _draw_hidden(column: bpy.types.UILayout, slot: bpy.types.PropertyGroup) -> None:
    from ..scene_io.review import unknown_bones  # it loads SciPy, which Blender's start shall not

    unknown = unknown_bones.unknown_bones(slot.armature)
    if unknown:
        column.label(text=f"{slot.name}: nothing shows", icon="QUESTION")
        for part in unknown:
            column.label(text=part, icon="BLANK1")
    hidden = [part for part in bone_visibility.hidden_parts(slot.armature) if part not in unknown]
    seen = "every other part is seen" if unknown else "every part is seen"
    column.label(text=f"{slot.name}: {'no camera sees' if hidden else seen}")
    for part in hidden:
        column.label(text=part, icon="HIDE_ON")


def _draw_lost(column: bpy.types.UILayout, context: bpy.types.Context, slot: bpy.types.PropertyGroup) -> None:
    if slot.lost:
        column.separator()
        draw_text(column, context, "May be lost: the footage does not show it there")
    for part in slot.lost:
        first, last = part.frames
        button = column.operator(GoToFrame.bl_idname, text=f"{part.name}: {first} to {last}", icon="ERROR")
        button.frame = (first + last) // 2
        button.reason = f"Jump there: the footage does not show {part.name} where it lies; pose it and set a key pose"


def _draw_helpful(column: bpy.types.UILayout, slot: bpy.types.PropertyGroup) -> None:
    if slot.helpful:
        column.separator()
        column.label(text="One more key pose would help most at")
    for key in slot.helpful:
        text = f"{key.frame}: {key.error:.0f} mm, {_first_of(key.name)}"
        button = column.operator(GoToFrame.bl_idname, text=text, icon="KEY_HLT")
        button.frame = key.frame
        button.reason = (
            f"Jump there and correct the pose: {key.name} may be {key.error:.0f} mm off. A key "
            f"pose would lower the expected error of the whole shot by {key.gain:.1f} mm"
        )


def _first_of(names: str) -> str:
    """Return the first of some bones, and how many more there are: a button has room for as much."""
    first, *others = names.split(", ")
    return f"{first} +{len(others)}" if others else first


def _draw_suggestions(column: bpy.types.UILayout, slot: bpy.types.PropertyGroup) -> None:
    if slot.suggestions:
        column.separator()
        column.label(text="Long out of sight: a key pose beside it at")
    for suggestion in slot.suggestions:
        button = column.operator(
            GoToFrame.bl_idname, text=f"{suggestion.frame}: {_first_of(suggestion.name)}", icon="HIDE_ON"
        )
        button.frame = suggestion.frame
        first, last = suggestion.hidden
        button.reason = (
            f"Jump there and pose {suggestion.name}: seen on this frame, but by no camera on frames {first} to {last}"
        )


def _draw_plants(column: bpy.types.UILayout, context: bpy.types.Context) -> None:
    """When the feet of the chosen performer are planted: a bar for each point, with buttons to change it."""
    slot, properties = active_performer.chosen(context), context.scene.kfmocap
    row = column.row(align=True)
    row.label(text=f"{slot.name}: feet on the ground")
    row.prop(properties, "show_plants", text="", icon="ACTION")
    row.operator(FindPlants.bl_idname, text="", icon="FILE_REFRESH")
    if slot.plant_edits:
        row.operator(ForgetPlantEdits.bl_idname, text="", icon="X")
    for name in slot.plants_found.split():
        row = column.row(align=True)
        label = row.column()
        label.ui_units_x = LABEL_UNITS
        label.label(text=name)
        plants = [(plant.first, plant.last) for plant in slot.plants if plant.name == name]
        _draw_bar(row, plants, (properties.frame_start, properties.frame_start + properties.length - 1))
        for planted, icon in ((True, "ADD"), (False, "REMOVE")):
            button = row.operator(SetPlant.bl_idname, text="", icon=icon)
            button.point, button.planted = name, planted
    if slot.plants_found and not slot.plants:
        column.label(text="The feet creep: none is held still", icon="INFO")
    if slot.plants:
        column.operator(CleanFeet.bl_idname, icon="CON_FLOOR")


LEAST_SHARE = 0.04
"""Least share of a bar that a plant takes up, as a button of less cannot be seen."""
LABEL_UNITS = 2.6
"""Width of the point's name before it, which a share of the row would cut off in a narrow sidebar."""
BAR_UNITS = 5.0
"""Width that a bar asks for, in units of the interface; it is drawn as wide as there is room."""


def _draw_bar(layout: bpy.types.UILayout, plants: list[tuple[int, int]], frames: tuple[int, int]) -> None:
    """Draw a bar over some frames, with a button for each plant and each gap.

    Columns of a fixed width alone are drawn as narrow as is asked for. Gaps are buttons, too, and bars not aligned with
    one another, as Blender moves the edges of aligned buttons together where they are a few pixels apart.
    """
    row, length = layout.row(align=True), frames[1] + 1.0 - frames[0]
    for start, stop, (first, last), planted in bar_pieces(plants, frames):
        piece = row.column(align=True)
        piece.ui_units_x = BAR_UNITS * (stop - start) / length
        button = piece.operator(GoToFrame.bl_idname, text=" ", depress=planted)
        button.frame = first
        button.reason = f"{'Planted' if planted else 'Not planted'} from frame {first} to {last}. Jump to the first"


def bar_pieces(
    plants: list[tuple[int, int]], frames: tuple[int, int]
) -> list[tuple[float, float, tuple[int, int], bool]]:
    """Return for each piece of a bar where it begins and ends, in frames, its first and last frame, and whether it is
    a plant.

    Parameters
    ----------
    plants : list of tuple of int
        First and last frame of each plant, in their order.
    frames : tuple of int
        First and last frame that the bar shows.
    """
    at, begin, after = float(frames[0]), frames[0], frames[1] + 1.0
    shown = [(first, last) for first, last in plants if last >= begin and first < after]
    least = min(LEAST_SHARE, 1 / max(len(shown), 1)) * (after - begin)
    pieces = []
    for others, (first, last) in zip(reversed(range(len(shown))), shown, strict=True):
        start = max(at, min(first, after - (others + 1) * least))
        stop = min(max(last + 1, start + least), after - others * least)
        if start > at:
            pieces.append((at, start, (begin, first - 1), False))
        pieces.append((start, stop, (first, last), True))
        at, begin = stop, last + 1
    return [*pieces, (at, after, (begin, frames[1]), False)] if at < after else pieces


CLASSES = (ReviewPanel,)
