"""A scene's capture of L-frame and wand (`properties.capture_properties`) as the core takes it, and back."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING

import bpy

from ...core.errors import CalibrationError

if TYPE_CHECKING:
    from ...core.capture.capture_videos import CaptureVideos, CaptureVideoView
    from ...core.capture.colours import Colour

LEAST_VIEWS = 2
"""Fewest cameras that can be calibrated."""
SLOTS = ("lframe", "first", "second")
"""The colours that can be picked: of the L-frame's balls, the wand's first and its second."""
_LABELS = {"lframe": "L-frame", "first": "Wand, first ball", "second": "Wand, second ball"}


def slot_items() -> list[tuple[str, str, str]]:
    """Return the colours as an enumeration's items."""
    return [(slot, _LABELS[slot], "") for slot in SLOTS]


def wanted_slots(capture: bpy.types.PropertyGroup) -> tuple[str, ...]:
    """Return the colours that this capture needs."""
    return SLOTS[:2] if capture.one_colour else SLOTS


def is_picked(colour: bpy.types.PropertyGroup) -> bool:
    """Whether a colour was picked: a range of no width is none."""
    return colour.hue[0] != colour.hue[1]


def missing(capture: bpy.types.PropertyGroup) -> str:
    """Return what there is to do before cameras can be solved from a capture; empty when there is nothing."""
    if len(capture.views) < LEAST_VIEWS:
        return "With a wand: add its videos of at least two cameras. If you have none, open Without a Wand"
    slot = slot_to_pick(capture)
    return f"Pick the colour: {_LABELS[slot]}" if slot else ""


def slot_to_pick(capture: bpy.types.PropertyGroup) -> str:
    """Return the first kind of ball whose colour is not picked yet; empty where there is none."""
    return next((slot for slot in wanted_slots(capture) if not is_picked(capture.colour(slot))), "")


def read_capture(capture: bpy.types.PropertyGroup) -> CaptureVideos:
    """Read the capture that a scene describes, as the core takes it.

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
        views=tuple(_read_view(view) for view in capture.views),
    )


def _read_view(view: bpy.types.PropertyGroup) -> CaptureVideoView:
    from ...core.capture.capture_videos import CaptureVideoView

    return CaptureVideoView(
        view.name,
        video_of(view, "lframe") if view.lframe else None,
        video_of(view, "wand"),
        offset=round(view.offset, 5) if view.knows_offset else None,
        focal=view.focal or None,
    )


def video_of(view: bpy.types.PropertyGroup, take: str) -> Path:
    """Return the path of a view's video of the L-frame or the wand.

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


def show_capture(capture: bpy.types.PropertyGroup, given: CaptureVideos) -> None:
    """Fill a scene's capture from one that a file describes.

    Raises
    ------
    CalibrationError
        It has no L-frame.
    """
    if given.floor or given.performer is not None:
        todo = "calibrate it with the kfmocap command, then import the cameras"
        raise CalibrationError("a capture without an L-frame cannot be edited in Blender", where="[floor]", todo=todo)
    capture.corner, capture.middle, capture.end, capture.side = given.lframe_points.tolist()
    capture.lframe_diameter, capture.wand_diameter = given.lframe_diameter or 0.0, given.wand_diameter or 0.0
    capture.length, capture.one_colour = given.wand_length, len(given.wand_colours) == 1
    for slot, colour in zip(SLOTS, (given.lframe_colour, *given.wand_colours), strict=False):
        capture.colour(slot).put(colour, typical(colour))
    capture.views.clear()
    for view in given.views:
        item = capture.views.add()
        item.name, item.wand = view.camera, str(view.wand)
        item.lframe = "" if view.lframe is None else str(view.lframe)
        item.knows_offset, item.offset = view.offset is not None, view.offset or 0.0
        item.focal = view.focal or 0.0


def typical(colour: Colour) -> tuple[float, float, float]:
    """Red, green and blue, 0..1, of the middle of a range."""
    import colorsys

    first, last = colour.hue
    hue = (first + ((last - first) % 360) / 2) % 360 / 360
    return colorsys.hsv_to_rgb(hue, sum(colour.saturation) / 2, sum(colour.value) / 2)
