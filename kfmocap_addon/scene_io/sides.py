"""The two sides of a body and their colours: the performer's left is blue, the right orange, the middle green."""

from __future__ import annotations

Colour = tuple[float, float, float, float]

SIDES: dict[str, tuple[str, Colour]] = {
    "L": ("Left", (0.25, 0.65, 1.0, 1.0)),
    "R": ("Right", (1.0, 0.45, 0.25, 1.0)),
    "": ("Middle", (0.75, 1.0, 0.4, 1.0)),
}
"""Label and colour (red, green, blue, opacity) by the letter of a side."""


def side_of(name: str) -> str:
    """The letter of the side that a landmark ("LWrist") or a bone ("hand.L") is on; empty for the middle."""
    letter = name[0] if name[1:2].isupper() else name[-1] if name[-2:-1] in (".", "_") else ""
    return letter if letter in SIDES else ""


def colour_of(name: str) -> Colour:
    """The colour of a landmark's or a bone's side."""
    return SIDES[side_of(name)][1]
