"""What a scene keeps of a capture of L-frame and wand, and of a calibration from a performer."""

from typing import TYPE_CHECKING

import bpy

from .body_fields import USUAL_HEIGHT, height_field

if TYPE_CHECKING:
    from ...core.capture.colours import Colour

_POINTS = ((0.0, 0.0, 0.0), (0.3, 0.0, 0.0), (0.6, 0.0, 0.0), (0.0, 0.2, 0.0))
_NAMES = ("Corner", "Long arm, middle", "Long arm, end", "Short arm")
_USUAL_FOCAL = 1000.0
"""Pixels."""


def _point(index: int) -> object:
    return bpy.props.FloatVectorProperty(
        size=3,
        subtype="XYZ",
        unit="LENGTH",
        precision=4,
        default=_POINTS[index],
        name=_NAMES[index],
        description="Centre of this ball in the world: x along the long arm, y along the short one, z up, metres",
    )


def _least_and_greatest(default: tuple[float, float], name: str, description: str) -> object:
    return bpy.props.FloatVectorProperty(size=2, min=0.0, max=1.0, default=default, name=name, description=description)


class KFMocapColour(bpy.types.PropertyGroup):
    """The range of colours of some balls."""

    hue: bpy.props.FloatVectorProperty(
        size=2, min=0.0, max=360.0, name="Hue", description="First and last hue, degrees; 340 to 20 goes through red"
    )
    saturation: _least_and_greatest((0.5, 1.0), "Saturation", "Least and greatest saturation, 0 to 1")
    value: _least_and_greatest((0.2, 1.0), "Value", "Least and greatest value (lightness), 0 to 1")
    swatch: bpy.props.FloatVectorProperty(
        size=3, subtype="COLOR_GAMMA", min=0.0, max=1.0, name="Colour", description="The ball where it was clicked on"
    )

    def get(self) -> "Colour":
        """Return the range as the core has it."""
        from ...core.capture.colours import Colour

        return Colour(tuple(self.hue), tuple(self.saturation), tuple(self.value))

    def put(self, colour: "Colour", swatch: tuple[float, float, float]) -> None:
        """Store a range, and the colour that stands for it."""
        self.hue, self.saturation, self.value = (
            [x % 360 for x in colour.hue] if colour.hue[1] - colour.hue[0] < 360 else colour.hue,
            colour.saturation,
            colour.value,
        )
        self.swatch = swatch


class KFMocapCaptureView(bpy.types.PropertyGroup):
    """A camera's two videos; its name is the camera's."""

    lframe: bpy.props.StringProperty(subtype="FILE_PATH", name="L-Frame", description="Video of the L-frame")
    wand: bpy.props.StringProperty(subtype="FILE_PATH", name="Wand", description="Video of the waved wand")
    knows_offset: bpy.props.BoolProperty(
        name="Offset Known", description="Use the offset given here, instead of estimating when the camera was started"
    )
    offset: bpy.props.FloatProperty(
        precision=3, name="Offset", description="Frame f of the capture is this video's frame f + offset, frames"
    )
    knows_focal: bpy.props.BoolProperty(
        get=lambda self: self.focal > 0,
        set=lambda self, known: setattr(self, "focal", _USUAL_FOCAL if known else 0.0),
        name="Focal Length Known",
        description="The focal length is known approximately. Otherwise it is estimated from scratch",
    )
    focal: bpy.props.FloatProperty(
        min=0.0,
        precision=0,
        name="Focal Length",
        description="Approximate focal length of this camera, in pixels of its videos",
    )


class KFMocapCapture(bpy.types.PropertyGroup):
    """The videos of an L-frame and a wand, and what is known of both."""

    views: bpy.props.CollectionProperty(type=KFMocapCaptureView)
    active: bpy.props.IntProperty(name="View", description="The view that is shown and clicked on")
    corner: _point(0)
    middle: _point(1)
    end: _point(2)
    side: _point(3)
    lframe_diameter: bpy.props.FloatProperty(
        min=0.0, unit="LENGTH", precision=4, name="Ball", description="Diameter of its balls, metres; 0: unknown"
    )
    length: bpy.props.FloatProperty(
        min=0.01,
        default=0.5,
        unit="LENGTH",
        precision=4,
        name="Length",
        description="Between the centres of the two balls, metres",
    )
    wand_diameter: bpy.props.FloatProperty(
        min=0.0, unit="LENGTH", precision=4, name="Ball", description="Diameter of its balls, metres; 0: unknown"
    )
    one_colour: bpy.props.BoolProperty(
        name="One Colour", description="Both balls of the wand have the same colour: the upper one is followed"
    )
    lframe: bpy.props.PointerProperty(type=KFMocapColour, description="Colour of the L-frame's balls")
    first: bpy.props.PointerProperty(type=KFMocapColour, description="Colour of the wand's first ball, or of both")
    second: bpy.props.PointerProperty(type=KFMocapColour, description="Colour of the wand's second ball")
    report: bpy.props.StringProperty(
        subtype="DIR_PATH",
        name="Report",
        description="Folder for the report's files; empty: the report is only shown in Blender",
    )

    summary: bpy.props.StringProperty(
        name="Result", description="Report on the cameras that were last found with a wand, one remark to a line"
    )

    performer_height: height_field(
        "Height of the performer, with shoes, metres: it gives the cameras their scale", default=USUAL_HEIGHT
    )
    performer_summary: bpy.props.StringProperty(
        name="Found", description="Report on the cameras that were last found from a performer, one remark to a line"
    )

    def colour(self, slot: str) -> KFMocapColour:
        """Give the colour of a ball."""
        return getattr(self, slot)


CLASSES = (KFMocapColour, KFMocapCaptureView, KFMocapCapture)
