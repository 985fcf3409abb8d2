"""Distortion coefficients that may belong to another lens model."""

from __future__ import annotations

import numpy as np

from .camera import Camera

_MAX_TANGENTIAL = 0.015
"""Largest tangential distortion of a lens that is mounted straight, several times that of usual ones."""


def fisheye_warning(camera: Camera) -> str:
    """Return a text that a camera's four coefficients may be those of OpenCV's fisheye model, whose third and fourth
    would be the tangential distortion of the usual one; empty if they need not be.
    """
    if camera.fisheye or len(camera.distortions) != 4 or np.hypot(*camera.distortions[2:]) <= _MAX_TANGENTIAL:
        return ""
    p1, p2 = camera.distortions[2:]
    return (
        f"its tangential distortion ({p1:.3g}, {p2:.3g}) is more than a lens has: if its four coefficients are of "
        "OpenCV's fisheye model, write fisheye = true (fisheye: 1 in OpenCV's files) for it into the calibration"
    )
