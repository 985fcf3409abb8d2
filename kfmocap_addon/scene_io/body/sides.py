"""The two sides of a body and their colours: the left is blue, the right orange, the middle the performer's own."""

from __future__ import annotations

from collections.abc import Sequence

Colour = tuple[float, float, float, float]

SIDES: dict[str, tuple[str, Colour]] = {
    "L": ("Left", (0.25, 0.65, 1.0, 1.0)),
    "R": ("Right", (1.0, 0.45, 0.25, 1.0)),
    "": ("Middle", (0.75, 1.0, 0.4, 1.0)),
}
"""Label and colour (red, green, blue, opacity) by the letter of a side."""

PERFORMERS: tuple[tuple[float, float, float], ...] = (
    (0.75, 1.0, 0.4),
    (1.0, 0.5, 0.95),
    (1.0, 0.9, 0.25),
    (0.45, 1.0, 0.95),
    (0.8, 0.7, 1.0),
    (1.0, 1.0, 1.0),
)
"""Colours of the middle of one performer after the other, unlike those of the sides."""


def side_of(name: str) -> str:
    """Return the letter of the side that a landmark ("LWrist") or a bone ("hand.L", "mixamorig:LeftHand") is on; empty
    for the middle.
    """
    from ....core.retargeting.bone_matching import side_of_bone  # it loads NumPy, which Blender's start shall not

    is_landmark = name[:1] in SIDES and name[1:2].isupper() and not name[2:3].isupper()
    return name[0] if is_landmark else side_of_bone(name)


def colour_of(name: str, middle: Sequence[float] = PERFORMERS[0]) -> Colour:
    """Return the colour of a landmark's or a bone's side; that of the middle is the performer's own."""
    side = side_of(name)
    return SIDES[side][1] if side else (middle[0], middle[1], middle[2], 1.0)
