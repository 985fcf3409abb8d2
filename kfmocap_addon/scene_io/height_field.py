"""A person's height as a field of a panel or of a tool."""

from typing import Any

import bpy

USUAL_HEIGHT = 1.75
"""Metres."""


def height_field(description: str, **access: Any) -> object:
    """A field for a height in metres, with a default or with functions that get and set it."""
    return bpy.props.FloatProperty(
        min=0.3, max=3.0, unit="LENGTH", precision=3, name="Height", description=description, **access
    )
