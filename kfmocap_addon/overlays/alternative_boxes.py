"""Poses that look alike from the camera, each drawn in a box as seen from the side, where they differ."""

from __future__ import annotations

from collections.abc import Sequence

import bpy
import numpy as np

from ...core.numerics.arrays import Array
from ..scene_io.body.sides import Colour
from . import mark_drawing

_WIDTH, _HEIGHT, _GAP, _MARGIN = 84, 110, 6, 16  # pixels
_UNBOUNDED = (0.0, float("inf"))
_MIN_JOINT_DISTANCE = 10  # pixels: a joint so near to a box is too near
_BACKGROUND_COLOUR: Colour = (0.08, 0.08, 0.08, 0.8)
_CHOSEN_COLOUR: Colour = (0.27, 0.45, 0.75, 0.9)
_TEXT_COLOUR: Colour = (1.0, 1.0, 1.0, 1.0)
_OTHERS_OPACITY = 0.75
"""Opacity of the poses that are not chosen."""

Box = tuple[float, float, float, float]
"""Left, bottom, right, top in the region."""


def boxes(
    count: int, scale: float | None = None, *, upper: float | None = None, sides: tuple[float, float] = _UNBOUNDED
) -> list[Box]:
    """Return where the boxes are, in a row from the lower left of the region, or at the top below an upper edge.

    Parameters
    ----------
    scale : float, optional
        Of the interface; by default Blender's.
    upper : float, optional
        What is above it is covered by bars.
    sides : tuple of float
        What is to the left and to the right of these is covered; boxes are as much narrower as the row asks for.
    """
    scale = bpy.context.preferences.system.ui_scale if scale is None else scale
    left, right = sides[0] + _MARGIN * scale, sides[1] - _MARGIN * scale
    step = min((_WIDTH + _GAP) * scale, (right - left + _GAP * scale) / max(count, 1))
    bottom = _MARGIN * scale if upper is None else upper - (_MARGIN + _HEIGHT) * scale
    return [
        (x, bottom, x + step - _GAP * scale, bottom + _HEIGHT * scale) for x in (left + i * step for i in range(count))
    ]


def row_beside(
    joints: Sequence[Sequence[float]],
    count: int,
    upper: float,
    scale: float | None = None,
    *,
    sides: tuple[float, float] = _UNBOUNDED,
) -> list[Box]:
    """Return where the boxes are so that joints can still be clicked: at the bottom, or if more joints lie there, at
    the top.

    Parameters
    ----------
    joints : sequence of (float, float)
        Positions in the region.
    upper, scale, sides
        See `boxes`.
    """

    def covered(row: list[Box]) -> int:
        left, bottom, right, top = row[0][0], row[0][1], row[-1][2], row[0][3]
        return sum(
            left <= x <= right and bottom - _MIN_JOINT_DISTANCE <= y <= top + _MIN_JOINT_DISTANCE for x, y in joints
        )

    return min(boxes(count, scale, sides=sides), boxes(count, scale, upper=upper, sides=sides), key=covered)


def box_at(found: Sequence[Box], x: float, y: float) -> int | None:
    """Number of the box at a position of the region; None beside them."""
    inside = (i for i, box in enumerate(found) if box[0] <= x <= box[2] and box[1] <= y <= box[3])
    return next(inside, None)


def from_the_side(bones: Array, centre_world: Array) -> Array:
    """Bones (N, P, 2, 3) in the world as seen from the right of a camera, which itself is to the left of the picture:
    away from the camera and up, metres, shape (N, P, 2, 2).
    """
    away = bones.mean(axis=(0, 1, 2)) - centre_world
    away[2] = 0.0
    away /= max(float(np.linalg.norm(away)), 1e-9)
    return np.stack([bones @ away, bones[..., 2]], axis=-1)


def draw(row: Sequence[Box], bones: Array, colours: Sequence[Colour], centre_world: Array, chosen: int) -> None:
    """Draw poses into their boxes.

    Parameters
    ----------
    row : sequence of Box, length N
    bones : ndarray, shape (N, P, 2, 3)
        Ends of the bones of each pose in the world.
    colours : sequence of Colour, length P
    centre_world : ndarray, shape (3,)
        The camera's centre.
    chosen : int
    """
    flat = from_the_side(bones, centre_world)
    low, high = flat.min(axis=(0, 1, 2)), flat.max(axis=(0, 1, 2))
    for i, (left, bottom, right, top) in enumerate(row):
        mark_drawing.bar((left, bottom), (right, top), _CHOSEN_COLOUR if i == chosen else _BACKGROUND_COLOUR)
        size = 0.85 * min((right - left) / max(high[0] - low[0], 1e-6), (top - bottom) / max(high[1] - low[1], 1e-6))
        middle = np.array([left + right, bottom + top]) / 2
        for ends, (red, green, blue, _) in zip(flat[i], colours, strict=True):
            (x0, y0), (x1, y1) = middle + size * (ends - (low + high) / 2)
            shown = (red, green, blue, 1.0 if i == chosen else _OTHERS_OPACITY)
            mark_drawing.lines([(float(x0), float(y0)), (float(x1), float(y1))], shown, 2.5)
        mark_drawing.label(str(i + 1), (left + 5, bottom + 5), _TEXT_COLOUR)
