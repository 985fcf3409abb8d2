"""Marks and joints drawn over the footage."""

from __future__ import annotations

import math
from collections.abc import Sequence

import blf
import bpy
import gpu
from gpu_extras.batch import batch_for_shader
from mathutils import Vector

from ..scene_io import active_performer, joint_marks
from ..scene_io.body.sides import Colour, colour_of
from ..viewports import viewport

Position = Sequence[float] | Vector
_RADIUS, _SIDES = 5.0, 16
_BACKGROUND_COLOUR = (0.0, 0.0, 0.0, 0.75)
_TEXT, _EDGE, _BESIDE = 13, 4, 14
"""Height of letters, how much larger the plate behind them is, and how far from the pointer they are, pixels."""


def draw_marks() -> None:
    """Draw the chosen performer's marks of this frame in a 3D view that looks through a camera of the shot."""
    context = bpy.context
    if not context.scene.kfmocap.show_marks:
        return
    slot = active_performer.chosen(context)
    if slot is None or not len(slot.marks):
        return
    look = viewport.look_of(context.scene, context.area, context.region, context.space_data)
    found = joint_marks.on_frame(slot, context.scene.frame_current) if look is not None else {}
    if any(view == look.view.name for view, _ in found):
        from ...core.posing.clicks import ray
        from ..scene_io.cameras import distortion

        matrix = distortion.intrinsic_matrix(
            look.view.camera.data, distortion.Frame(tuple(look.view.size), tuple(look.view.aspect))
        )
        for (view, landmark), pixel in found.items():
            position = look.position(tuple(ray(matrix, pixel))) if view == look.view.name else None
            if position is not None:
                dot(position, colour_of(landmark))


def dot(at: Position, colour: Colour) -> None:
    """A filled dot with a dark rim."""
    for size, fill in ((_RADIUS + 1.5, _BACKGROUND_COLOUR), (_RADIUS, colour)):
        _drawn("TRI_FAN", _circle(at, size * _scale()), fill)


def bar(low: Position, high: Position, colour: Colour) -> None:
    """A filled rectangle from its lower left to its upper right corner."""
    corners: list[tuple[float, float]] = [(low[0], low[1]), (high[0], low[1]), (high[0], high[1]), (low[0], high[1])]
    _drawn("TRI_FAN", corners, colour)


def triangles(corners: Sequence[tuple[float, float]], colour: Colour) -> None:
    """Filled triangles, three corners for each."""
    _drawn("TRIS", corners, colour)


def ring(at: Position, colour: Colour, radius: float = _RADIUS) -> None:
    """A circle."""
    lines([*_circle(at, radius * _scale()), _circle(at, radius * _scale())[0]], colour)


def lines(points: Sequence[Position], colour: Colour, width: float = 1.5) -> None:
    """A line through points."""
    shader = gpu.shader.from_builtin("POLYLINE_UNIFORM_COLOR")
    batch = batch_for_shader(shader, "LINE_STRIP", {"pos": [(x, y, 0.0) for x, y in points]})
    gpu.state.blend_set("ALPHA")
    shader.bind()
    shader.uniform_float("viewportSize", gpu.state.viewport_get()[2:])
    shader.uniform_float("lineWidth", width * _scale())
    shader.uniform_float("color", colour)
    batch.draw(shader)
    gpu.state.blend_set("NONE")


def label(text: str, at: Position, colour: Colour) -> None:
    """A text whose lower left is at a position, on a dark plate: footage has any colours."""
    width, edge = width_of(text), _EDGE * _scale()
    bar(
        (at[0] - edge, at[1] - edge), (at[0] + width + edge, at[1] + 0.75 * _TEXT * _scale() + edge), _BACKGROUND_COLOUR
    )
    blf.position(0, at[0], at[1], 0)
    blf.color(0, *colour)
    blf.draw(0, text)


def width_of(text: str) -> float:
    """Return the width of a label, pixels."""
    blf.size(0, _TEXT * _scale())
    return float(blf.dimensions(0, text)[0])


def beside(pointer: float, width: float, right: float) -> float:
    """Return where a label of a width begins beside the pointer: to its right, or if that is beyond the right end of
    what is seen, to its left.
    """
    return pointer + _BESIDE if pointer + _BESIDE + width + _EDGE <= right else pointer - _BESIDE - width


def _circle(at: Position, radius: float) -> list[tuple[float, float]]:
    turn = 2 * math.pi / _SIDES
    return [(at[0] + radius * math.cos(i * turn), at[1] + radius * math.sin(i * turn)) for i in range(_SIDES)]


def _drawn(kind: str, points: Sequence[tuple[float, float]], colour: Colour) -> None:
    shader = gpu.shader.from_builtin("UNIFORM_COLOR")
    batch = batch_for_shader(shader, kind, {"pos": points})
    gpu.state.blend_set("ALPHA")
    shader.uniform_float("color", colour)
    batch.draw(shader)
    gpu.state.blend_set("NONE")


def _scale() -> float:
    return bpy.context.preferences.system.ui_scale
