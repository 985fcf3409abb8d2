"""How far the simplification of curves may change the motion, as fields."""

import math

import bpy


def turn_tolerance(degrees: float, description: str) -> object:
    """Return a field for the largest change of a rotation; its default is given in degrees, its value in radians."""
    default = math.radians(degrees)
    return bpy.props.FloatProperty(
        default=default, min=0.0, soft_max=10 * default, subtype="ANGLE", name="Rotation", description=description
    )


def shift_tolerance(millimetres: float, description: str) -> object:
    """Return a field for the largest change of a position, in millimetres, as is its default."""
    return bpy.props.FloatProperty(
        default=millimetres, min=0.0, soft_max=50.0, name="Location (mm)", description=description
    )
