"""Lengths of a performer's body as fields: in the panel, where they change a body, and in Add Body."""

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

import bpy

USUAL_HEIGHT = 1.75
"""Metres."""
MEASURES: Mapping[str, tuple[str, str]] = MappingProxyType(
    {
        "shoulder_width": ("Shoulder Width", "Between the centres of the shoulder joints"),
        "hip_width": ("Hip Width", "Between the centres of the hip joints"),
        "torso": ("Torso", "From the middle of the hip joints to the base of the neck"),
        "head": ("Head", "From the base of the neck to the top of the head"),
        "upper_arm": ("Upper Arm", "From the centre of the shoulder joint to the elbow"),
        "forearm": ("Forearm", "From the elbow to the wrist"),
        "hand": ("Hand", "From the wrist to the finger tips"),
        "thigh": ("Thigh", "From the centre of the hip joint to the knee"),
        "shin": ("Shin", "From the knee to the ankle"),
        "foot": ("Foot", "From the ankle to the big toe"),
    }
)
"""Label and description of each measure of `core.body.measures.proportions` that can be taken with a tape."""


def height_field(description: str, **access: Any) -> object:
    """Return a field for a height in metres, with a default or with functions that get and set it."""
    return bpy.props.FloatProperty(
        min=0.3, max=3.0, unit="LENGTH", precision=3, name="Height", description=description, **access
    )


def length_field(label: str, description: str, **access: Any) -> object:
    """Return a field for the length of a part in metres, with a least value or with functions that get and set it."""
    return bpy.props.FloatProperty(
        soft_max=1.0, unit="LENGTH", precision=3, name=label, description=description, **access
    )
