"""A strip below the footage: key poses, tracked frames, and frames on which a part of the performer may be lost."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import bpy

from ..scene_io import active_performer
from ..scene_io.body.sides import Colour
from ..session import SESSION
from ..viewports import screens, viewport
from ..viewports.key_list import known_keys
from . import mark_drawing

Run = tuple[int, int]
"""First and last scene frame."""
Box = tuple[float, float, float, float]
"""Left, bottom, right, top in the region."""
Triangles = tuple[tuple[float, float], ...]
"""Corners, three for each."""

HEIGHT = 13
"""Pixels, from the lower edge: no higher than what else is drawn there begins (`alternative_boxes`)."""
_BACKGROUND_COLOUR: Colour = (0.05, 0.05, 0.05, 0.6)
_TRACKED: Colour = (0.75, 0.75, 0.75, 0.7)
_LOST_COLOUR: Colour = (0.95, 0.15, 0.1, 0.9)
_CURRENT_FRAME_COLOUR: Colour = (0.35, 0.6, 1.0, 1.0)
_PROPOSAL_OPACITY = 0.45
"""Opacity of proposed key poses."""
_TRACKED_HEIGHT, _LOST_HEIGHT, _WHOLE, _PART = 2.0, 4.0, 5.0, 3.0
"""Pixels: height of the bands of tracked and of lost frames; half the size of key poses of the whole body, and of
some bones.
"""
_STRIPS = 8  # whose triangles are remembered: one per 3D view that shows one


@dataclass(frozen=True)
class Strip:
    """What the strip shows, in scene frames.

    Attributes
    ----------
    frames : tuple of int
        First and last of the shot.
    colour : tuple of float
        The performer's: red, green, blue.
    whole, partial, proposed : tuple of int
        Key poses of the whole body, of some bones, and the tracker's proposals.
    tracked, lost : tuple of Run
        Frames with tracked keys, and those on which some part may be lost.
    """

    frames: Run
    colour: tuple[float, float, float]
    whole: tuple[int, ...] = ()
    partial: tuple[int, ...] = ()
    proposed: tuple[int, ...] = ()
    tracked: tuple[Run, ...] = ()
    lost: tuple[Run, ...] = ()


def strip_of(context: bpy.types.Context) -> Strip | None:
    """Return the strip under the footage for the chosen performer; None without one, or before it is looked up."""
    slot, scene = active_performer.chosen(context), context.scene
    entries = known_keys().entries(slot.armature) if slot is not None else None
    if slot is None or entries is None:
        return None
    start = scene.kfmocap.frame_start
    own = [entry for entry in entries if not entry.proposed]
    return Strip(
        frames=(start, start + max(scene.kfmocap.length, 1) - 1),
        colour=(slot.colour[0], slot.colour[1], slot.colour[2]),
        whole=tuple(entry.frame for entry in own if not entry.bones),
        partial=tuple(entry.frame for entry in own if entry.bones),
        proposed=tuple(entry.frame for entry in entries if entry.proposed),
        tracked=known_keys().tracked(slot.armature),
        lost=tuple((part.frames[0], part.frames[1]) for part in slot.lost),
    )


def draw(strip: Strip) -> None:
    """Draw the strip along the lower edge of the 3D view that is being drawn, if that looks through a shot's camera."""
    context = bpy.context
    if viewport.look_of(context.scene, context.area, context.region, context.space_data) is None:
        return
    scale = context.preferences.system.ui_scale
    region, free = context.region, screens.uncovered_part(context.area)
    left, low = free[0] - region.x, free[1] - region.y
    box = (left, low, free[2] - region.x, low + HEIGHT * scale)
    for colour, corners in pieces(strip, box, scale):
        mark_drawing.triangles(corners, colour)
    if strip.frames[0] <= context.scene.frame_current <= strip.frames[1]:
        at = position(strip.frames, box, context.scene.frame_current)
        mark_drawing.bar((at - scale, box[1]), (at + scale, box[3]), _CURRENT_FRAME_COLOUR)


def position(frames: Run, box: Box, frame: float) -> float:
    """Return where the middle of a frame is in a box that spans frames."""
    return box[0] + (frame - frames[0] + 0.5) * (box[2] - box[0]) / max(frames[1] - frames[0] + 1, 1)


def pieces(strip: Strip, box: Box, scale: float) -> tuple[tuple[Colour, Triangles], ...]:
    """Return what there is to draw but the current frame: colours and triangles, the lowest first; remembered."""
    return SESSION.remembering(_pieces, _STRIPS)(strip, box, scale)


def _pieces(strip: Strip, box: Box, scale: float) -> tuple[tuple[Colour, Triangles], ...]:
    low, high, middle = box[1], box[3], (box[1] + box[3]) / 2

    def bands(runs: Sequence[Run], bottom: float, top: float) -> Triangles:
        spans = (
            (position(strip.frames, box, first - 0.5), position(strip.frames, box, last + 0.5))
            for first, last in _within(runs, strip.frames)
        )
        return tuple(corner for x0, x1 in spans for corner in _rectangle(x0, bottom, x1, top))

    def diamonds(frames: Sequence[int], size: float) -> Triangles:
        return tuple(
            corner
            for frame in frames
            if strip.frames[0] <= frame <= strip.frames[1]
            for corner in _diamond(position(strip.frames, box, frame), middle, size * scale)
        )

    half = _TRACKED_HEIGHT * scale / 2
    found: list[tuple[Colour, Triangles]] = [
        (_BACKGROUND_COLOUR, _rectangle(box[0], low, box[2], high)),
        (_TRACKED, bands(strip.tracked, middle - half, middle + half)),
        (_LOST_COLOUR, bands(strip.lost, low, low + _LOST_HEIGHT * scale)),
        ((*strip.colour, _PROPOSAL_OPACITY), diamonds(strip.proposed, _WHOLE)),
        ((*strip.colour, 1.0), diamonds(strip.whole, _WHOLE) + diamonds(strip.partial, _PART)),
    ]
    return tuple((colour, corners) for colour, corners in found if corners)


def _within(runs: Sequence[Run], frames: Run) -> list[Run]:
    """Return the parts of runs that lie in a range of frames; what overlaps is one, so that it is not drawn twice."""
    joined: list[Run] = []
    for first, last in sorted((max(a, frames[0]), min(b, frames[1])) for a, b in runs):
        if first > last:
            continue
        if joined and first <= joined[-1][1] + 1:
            joined[-1] = (joined[-1][0], max(last, joined[-1][1]))
        else:
            joined.append((first, last))
    return joined


def _rectangle(left: float, low: float, right: float, high: float) -> Triangles:
    return ((left, low), (right, low), (right, high), (left, low), (right, high), (left, high))


def _diamond(x: float, y: float, size: float) -> Triangles:
    return ((x - size, y), (x, y - size), (x + size, y), (x - size, y), (x + size, y), (x, y + size))
