"""The joints that the animator has clicked, stored in the scene by performer, view and frame."""

from __future__ import annotations

import bpy

Snapshot = dict[tuple[str, str], tuple[float, float]]
"""The marks of a frame: pixels by view and landmark."""
AllMarks = list[tuple[str, str, int, tuple[float, float]]]
"""Landmark, view, scene frame and pixel of every mark of a performer."""


def on_frame(slot: bpy.types.PropertyGroup, frame: int) -> Snapshot:
    """Return a performer's marks on a scene frame."""
    return {(mark.view, mark.name): tuple(mark.pixel) for mark in slot.marks if mark.frame == frame}


def put(slot: bpy.types.PropertyGroup, frame: int, marks: Snapshot) -> None:
    """Replace the marks of a frame."""
    missing = dict(marks)
    for index in reversed(range(len(slot.marks))):
        mark = slot.marks[index]
        if mark.frame == frame:
            pixel = missing.pop((mark.view, mark.name), None)
            if pixel is None:
                slot.marks.remove(index)
            else:
                mark.pixel = pixel
    for (view, landmark), pixel in missing.items():
        _add(slot, landmark, view, frame, pixel)


def all_marks(slot: bpy.types.PropertyGroup) -> AllMarks:
    """All marks of a performer."""
    return [(mark.name, mark.view, mark.frame, tuple(mark.pixel)) for mark in slot.marks]


def restore(slot: bpy.types.PropertyGroup, marks: AllMarks) -> None:
    """Restore all marks, in their order."""
    slot.marks.clear()
    for mark in marks:
        _add(slot, *mark)


def _add(slot: bpy.types.PropertyGroup, landmark: str, view: str, frame: int, pixel: tuple[float, float]) -> None:
    mark = slot.marks.add()
    mark.name, mark.view, mark.frame, mark.pixel = landmark, view, frame, pixel
