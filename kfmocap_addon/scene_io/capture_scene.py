"""What a scene knows of a capture of L-frame and wand, and that capture as the core wants it."""

import os
from pathlib import Path
from typing import TYPE_CHECKING

import bpy

from ...core.errors import CalibrationError
from .height_field import USUAL_HEIGHT, height_field

if TYPE_CHECKING:
    from ...core.capture.capture_videos import CaptureVideos, CaptureVideoView
    from ...core.capture.colours import Colour

LEAST_VIEWS = 2
SLOTS = ("lframe", "first", "second")
"""The colours that can be picked: of the L-frame's balls, the wand's first and its second."""
_LABELS = {"lframe": "L-frame", "first": "Wand, first ball", "second": "Wand, second ball"}
_POINTS = ((0.0, 0.0, 0.0), (0.3, 0.0, 0.0), (0.6, 0.0, 0.0), (0.0, 0.2, 0.0))
_USUAL_FOCAL = 1000.0
_NAMES = ("Corner", "Long arm, middle", "Long arm, end", "Short arm")


def slot_items() -> list[tuple[str, str, str]]:
    """The colours as an enumeration's items."""
    return [(slot, _LABELS[slot], "") for slot in SLOTS]


def _point(index: int) -> object:
    return bpy.props.FloatVectorProperty(
        size=3,
        subtype="XYZ",
        unit="LENGTH",
        precision=4,
        default=_POINTS[index],
        name=_NAMES[index],
        description="Centre of this ball in the world: x along the long arm, y along the short one, z up",
    )


class KFMocapColour(bpy.types.PropertyGroup):
    """A range of colours."""

    hue: bpy.props.FloatVectorProperty(
        size=2, min=0.0, max=360.0, name="Hue", description="First and last hue, degrees; 340 to 20 goes through red"
    )
    saturation: bpy.props.FloatVectorProperty(
        size=2, min=0.0, max=1.0, default=(0.5, 1.0), name="Saturation", description="Least and greatest"
    )
    value: bpy.props.FloatVectorProperty(
        size=2, min=0.0, max=1.0, default=(0.2, 1.0), name="Value", description="Least and greatest lightness"
    )
    swatch: bpy.props.FloatVectorProperty(
        size=3, subtype="COLOR_GAMMA", min=0.0, max=1.0, name="Colour", description="The ball where it was clicked on"
    )

    def get(self) -> "Colour":
        """The range as the core has it."""
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
    knows_offset: bpy.props.BoolProperty(name="Offset Known", description="Do not estimate when the camera was started")
    offset: bpy.props.FloatProperty(
        precision=3, name="Offset", description="Frame f of the capture is this video's frame f + offset, frames"
    )
    knows_focal: bpy.props.BoolProperty(
        get=lambda self: self.focal > 0,
        set=lambda self, known: setattr(self, "focal", _USUAL_FOCAL if known else 0.0),
        name="Focal Length Known",
        description="The lens is known roughly. Else it is estimated from scratch",
    )
    focal: bpy.props.FloatProperty(
        min=0.0, precision=0, name="Focal Length", description="Of this camera, roughly, in pixels of its videos"
    )


class KFMocapCapture(bpy.types.PropertyGroup):
    """An L-frame and a wand before cameras."""

    views: bpy.props.CollectionProperty(type=KFMocapCaptureView)
    active: bpy.props.IntProperty(name="View", description="The view that is shown and clicked on")
    corner: _point(0)
    middle: _point(1)
    end: _point(2)
    side: _point(3)
    lframe_diameter: bpy.props.FloatProperty(
        min=0.0, unit="LENGTH", precision=4, name="Ball", description="Diameter of its balls; 0: unknown"
    )
    length: bpy.props.FloatProperty(
        min=0.01, default=0.5, unit="LENGTH", precision=4, name="Length", description="Between the balls' centres"
    )
    wand_diameter: bpy.props.FloatProperty(
        min=0.0, unit="LENGTH", precision=4, name="Ball", description="Diameter of its balls; 0: unknown"
    )
    one_colour: bpy.props.BoolProperty(
        name="One Colour", description="Both balls have the first one's colour: the upper one is followed"
    )
    lframe: bpy.props.PointerProperty(type=KFMocapColour, description="Colour of the L-frame's balls")
    first: bpy.props.PointerProperty(type=KFMocapColour, description="Colour of the wand's first ball, or of both")
    second: bpy.props.PointerProperty(type=KFMocapColour, description="Colour of the wand's second ball")
    report: bpy.props.StringProperty(
        subtype="DIR_PATH", name="Report", description="Folder for the report's files; empty: shown here alone"
    )

    performer_height: height_field(
        "Of the performer, with shoes: the scale of everything follows from it", default=USUAL_HEIGHT
    )
    performer_summary: bpy.props.StringProperty(
        name="Found", description="What was said of the cameras that were last found from a performer, in lines"
    )

    def colour(self, slot: str) -> KFMocapColour:
        """Give the colour of a ball."""
        return getattr(self, slot)


def wanted_slots(capture: KFMocapCapture) -> tuple[str, ...]:
    """The colours that this capture needs."""
    return SLOTS[:2] if capture.one_colour else SLOTS


def is_picked(colour: KFMocapColour) -> bool:
    """Whether a colour was picked: a range of no width is none."""
    return colour.hue[0] != colour.hue[1]


def missing(capture: KFMocapCapture) -> str:
    """What there is to do before cameras can be solved from a capture; empty when there is nothing."""
    if len(capture.views) < LEAST_VIEWS:
        return "Add the wand's videos of at least two cameras"
    open_slots = [_LABELS[slot] for slot in wanted_slots(capture) if not is_picked(capture.colour(slot))]
    return f"Pick the colour: {open_slots[0]}" if open_slots else ""


def film_of(capture: KFMocapCapture) -> "CaptureVideos":
    """The capture as the core films it.

    Raises
    ------
    CalibrationError
        There are no two views, or a colour or a file is missing; says which.
    """
    import numpy as np

    from ...core.capture.capture_videos import CaptureVideos

    if len(capture.views) < LEAST_VIEWS:
        raise CalibrationError("at least two views are needed", where="Calibration", todo="add the cameras' videos")
    for slot in wanted_slots(capture):
        if not is_picked(capture.colour(slot)):
            raise CalibrationError(
                "no colour is picked", where=_LABELS[slot], todo="click on the ball with Pick Colour"
            )
    return CaptureVideos(
        lframe_points=np.array([capture.corner, capture.middle, capture.end, capture.side], float).round(6),
        lframe_colour=capture.lframe.get(),
        lframe_diameter=capture.lframe_diameter or None,
        wand_length=round(float(capture.length), 6),
        wand_colours=tuple(capture.colour(slot).get() for slot in wanted_slots(capture)[1:]),
        wand_diameter=capture.wand_diameter or None,
        views=tuple(_film_view(view) for view in capture.views),
    )


def _film_view(view: KFMocapCaptureView) -> "CaptureVideoView":
    from ...core.capture.capture_videos import CaptureVideoView

    return CaptureVideoView(
        view.name,
        video_of(view, "lframe") if view.lframe else None,
        video_of(view, "wand"),
        offset=round(view.offset, 5) if view.knows_offset else None,
        focal=view.focal or None,
    )


def video_of(view: KFMocapCaptureView, take: str) -> Path:
    """The path of a view's video of the L-frame or the wand.

    Raises
    ------
    CalibrationError
        None is chosen.
    """
    path = getattr(view, take)
    if not path:
        what = "L-frame" if take == "lframe" else "wand"
        raise CalibrationError(f"no video of the {what} is chosen", where=f"view {view.name}")
    return Path(os.path.normpath(bpy.path.abspath(path)))


def show_film(capture: KFMocapCapture, film: "CaptureVideos") -> None:
    """Fill a scene's capture from one that a file describes.

    Raises
    ------
    CalibrationError
        It has no L-frame.
    """
    if film.floor or film.performer is not None:
        todo = "calibrate it with the kfmocap command, then import the cameras"
        raise CalibrationError("a capture without an L-frame cannot be edited in Blender", where="[floor]", todo=todo)
    capture.corner, capture.middle, capture.end, capture.side = film.lframe_points.tolist()
    capture.lframe_diameter, capture.wand_diameter = film.lframe_diameter or 0.0, film.wand_diameter or 0.0
    capture.length, capture.one_colour = film.wand_length, len(film.wand_colours) == 1
    for slot, colour in zip(SLOTS, (film.lframe_colour, *film.wand_colours), strict=False):
        capture.colour(slot).put(colour, typical(colour))
    capture.views.clear()
    for view in film.views:
        item = capture.views.add()
        item.name, item.wand = view.camera, str(view.wand)
        item.lframe = "" if view.lframe is None else str(view.lframe)
        item.knows_offset, item.offset = view.offset is not None, view.offset or 0.0
        item.focal = view.focal or 0.0


def typical(colour: "Colour") -> tuple[float, float, float]:
    """Red, green and blue, 0..1, of the middle of a range."""
    import colorsys

    first, last = colour.hue
    hue = (first + ((last - first) % 360) / 2) % 360 / 360
    return colorsys.hsv_to_rgb(hue, sum(colour.saturation) / 2, sum(colour.value) / 2)


CLASSES = (KFMocapColour, KFMocapCaptureView, KFMocapCapture)
