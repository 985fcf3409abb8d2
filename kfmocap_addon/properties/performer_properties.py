"""What a scene knows of a performer beyond its armature."""

from collections.abc import Callable

import bpy

from ..scene_io.body.sides import PERFORMERS
from .body_fields import MEASURES, height_field, length_field
from .pointer_polls import is_armature


def _show_performer(self: bpy.types.PropertyGroup, _context: bpy.types.Context) -> None:
    """Give the bones of the trunk the performer's colour."""
    from ..scene_io.body import body_armature

    if self.armature is not None:
        body_armature.show_colour(self.armature, self.colour)


def _height(self: bpy.types.PropertyGroup) -> float:
    from ..scene_io.body import performer_size

    return performer_size.height(self.armature) if self.armature is not None else 0.0


def _set_height(self: bpy.types.PropertyGroup, value: float) -> None:
    from ..scene_io.characters import character_size

    _reshape(self, lambda: character_size.set_height(self.armature, value))


def _measure(name: str) -> object:
    """One of `MEASURES` as a field, which is read from the armature and changes it."""

    def get(self: bpy.types.PropertyGroup) -> float:
        from ..scene_io.body import performer_size

        return performer_size.measure(self.armature, name) if self.armature is not None else 0.0

    def put(self: bpy.types.PropertyGroup, value: float) -> None:
        from ..scene_io.body import performer_size

        _reshape(self, lambda: performer_size.set_measure(self.armature, name, value))

    label, what = MEASURES[name]
    return length_field(label, f"{what}, metres; key poses stay as they are", get=get, set=put, min=0.01)


def _reshape(slot: bpy.types.PropertyGroup, change: Callable[[], None]) -> None:
    """Change a performer's body; an error pops up at the mouse, as fields cannot report."""
    from ...core.errors import KFMocapError

    try:
        if slot.armature is not None:
            change()
    except KFMocapError as error:
        text = str(error)
        if not bpy.app.background:
            bpy.context.window_manager.popup_menu(
                lambda menu, _context: menu.layout.label(text=text), title="KF Mocap", icon="ERROR"
            )


class KFMocapSuggestion(bpy.types.PropertyGroup):
    """A key frame that would help; its name is that of the parts which no camera sees just before or after."""

    frame: bpy.props.IntProperty(name="Frame", description="Scene frame on which the parts are seen")
    hidden: bpy.props.IntVectorProperty(
        size=2, name="Hidden", description="First and last scene frame on which they are not"
    )


class KFMocapHelpfulKey(bpy.types.PropertyGroup):
    """A key frame that would help most; its name is that of the parts which are expected to be farthest off there."""

    frame: bpy.props.IntProperty(name="Frame", description="Scene frame")
    error: bpy.props.FloatProperty(
        name="Error", description="Expected error there of the bone that may be farthest off, mm"
    )
    gain: bpy.props.FloatProperty(
        name="Gain", description="By how much a key pose there would lower the expected error over the shot, mean, mm"
    )


class KFMocapLostPart(bpy.types.PropertyGroup):
    """What may be lost on some frames: a part of a limb, whose name is the bone's, or the whole body."""

    frames: bpy.props.IntVectorProperty(size=2, name="Frames", description="First and last scene frame")


class KFMocapMark(bpy.types.PropertyGroup):
    """A joint that the animator clicked in a view; its name is the landmark's."""

    view: bpy.props.StringProperty(name="View", description="Name of the view")
    frame: bpy.props.IntProperty(name="Frame", description="Scene frame")
    pixel: bpy.props.FloatVectorProperty(
        size=2,
        precision=2,
        name="Pixel",
        description="Place on the undistorted footage from its upper left, pixels; whole numbers are pixel centres",
    )


class KFMocapPlant(bpy.types.PropertyGroup):
    """Frames on which a point of a sole stands on the ground, or, as tracking has tested or the animator has set, does
    not; its name is the point's, such as "heel.L".
    """

    first: bpy.props.IntProperty(name="First", description="First scene frame")
    last: bpy.props.IntProperty(name="Last", description="Last scene frame")
    planted: bpy.props.BoolProperty(default=True, name="Planted", description="It stands on the ground")


class KFMocapPerformer(bpy.types.PropertyGroup):
    """Somebody to track, by name; the armature is the body, its keys are the key poses."""

    armature: bpy.props.PointerProperty(
        type=bpy.types.Object, poll=is_armature, name="Armature", description="The performer's body"
    )
    person: bpy.props.IntProperty(
        min=0,
        name="Person",
        description=(
            "Which of the people in the views' keypoints the performer is, from 1 in the order in which they appear. "
            "0: the key poses say, or the order of the performers"
        ),
    )
    identity: bpy.props.StringProperty(
        name="Found", description="Which person the performer was found to be when keypoints were last used"
    )
    found_person: bpy.props.IntProperty(name="Found Person", description="The number of that person, from 1; 0: none")
    colour: bpy.props.FloatVectorProperty(
        size=3,
        subtype="COLOR_GAMMA",
        min=0.0,
        max=1.0,
        default=PERFORMERS[0],
        update=_show_performer,
        name="Colour",
        description="Colour of the outlines and bones of head and trunk; limbs have the colours of their sides",
    )
    height: height_field(
        "From the soles to the top of the head, metres; all lengths and widths change with it, key poses stay as they "
        "are",
        get=_height,
        set=_set_height,
    )
    shoulder_width: _measure("shoulder_width")
    hip_width: _measure("hip_width")
    torso: _measure("torso")
    head: _measure("head")
    upper_arm: _measure("upper_arm")
    forearm: _measure("forearm")
    hand: _measure("hand")
    thigh: _measure("thigh")
    shin: _measure("shin")
    foot: _measure("foot")
    suggestions: bpy.props.CollectionProperty(type=KFMocapSuggestion)
    helpful: bpy.props.CollectionProperty(type=KFMocapHelpfulKey)
    lost: bpy.props.CollectionProperty(type=KFMocapLostPart)
    marks: bpy.props.CollectionProperty(type=KFMocapMark)
    fingers: bpy.props.BoolProperty(
        name="Fingers",
        description="Files that the command line writes have the performer's fingers, by keypoints",
    )
    plants: bpy.props.CollectionProperty(type=KFMocapPlant)
    tested_plants: bpy.props.CollectionProperty(type=KFMocapPlant)
    plant_edits: bpy.props.CollectionProperty(type=KFMocapPlant)
    disturbances: bpy.props.StringProperty(
        name="Shown Otherwise",
        description="What kept the body from being shown as it was tracked, when it last was, one remark to a line",
    )
    plants_found: bpy.props.StringProperty(
        name="Plants Found", description="The points of the feet whose plants were looked for; empty before that"
    )


CLASSES = (KFMocapSuggestion, KFMocapHelpfulKey, KFMocapLostPart, KFMocapMark, KFMocapPlant, KFMocapPerformer)
