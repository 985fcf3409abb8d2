"""Worlds of other programs: calibrations in other units than metres, or with another axis than z pointing up."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from ..errors import CalibrationError
from .camera import Camera

METRES = {"m": 1.0, "cm": 0.01, "mm": 0.001}
"""Length of a unit of length, metres."""
AXES = {
    "z": [[1, 0, 0], [0, 1, 0], [0, 0, 1]],
    "-z": [[1, 0, 0], [0, -1, 0], [0, 0, -1]],
    "y": [[0, 0, 1], [1, 0, 0], [0, 1, 0]],
    "-y": [[1, 0, 0], [0, 0, 1], [0, -1, 0]],
    "x": [[0, 1, 0], [0, 0, 1], [1, 0, 0]],
    "-x": [[0, 0, 1], [0, 1, 0], [-1, 0, 0]],
}
"""Our x, y and z in the axes of a world, by the axis that points up there; for y as in TRC files."""
_MAX_APART = 100.0
"""Largest usual distance between two cameras of a shot, metres."""
_MAX_UPRIGHT = 0.35
"""Cosine of the angle between a picture's upward direction and the world's from which the camera lies on its side."""
_MIN_COMMON = 0.7
"""The same between the pictures' upward directions and another axis, for that to be what points up."""


@dataclass(frozen=True)
class FileWorld:
    """The world of a calibration file.

    Attributes
    ----------
    unit : str, optional
        One of `METRES`; None if it is not stated: metres, which is checked.
    up : str
        The axis that points up, one of `AXES`.
    """

    unit: str | None = None
    up: str = "z"

    def ours(self, camera: Camera) -> Camera:
        """Return a camera of this world in ours: metres, z up."""
        if self.unit in (None, "m") and self.up == "z":
            return camera
        axes = np.array(AXES[self.up], float)
        return replace(
            camera,
            R_cam_world=camera.R_cam_world @ axes.T,
            t_cam_world=camera.t_cam_world * METRES[self.unit or "m"],
        )

    def check(self, cameras: Sequence[Camera], todo: str) -> None:
        """Check that cameras, which are ours, are no farther apart than cameras of a shot are, unless the user has
        stated the unit.

        Parameters
        ----------
        cameras : sequence of Camera
        todo : str
            How the user states it, for the error.

        Raises
        ------
        CalibrationError
        """
        farthest = _farthest_apart(cameras)
        if self.unit is not None or farthest <= _MAX_APART:
            return
        for k, camera in enumerate(cameras):
            rest = _farthest_apart([*cameras[:k], *cameras[k + 1 :]])
            if 0 < rest <= _MAX_APART:
                what = (
                    f"'{camera.name}' is {farthest:.0f} m from the others, which are at most {rest:.1f} m apart: "
                    "its translation seems to be in another unit than theirs"
                )
                raise CalibrationError(what, todo=f"correct it in the file; if all of it is in another unit, {todo}")
        what = f"its cameras are up to {farthest:.0f} m apart, as if it were not in metres"
        raise CalibrationError(what, todo=todo)


def _farthest_apart(cameras: Sequence[Camera]) -> float:
    """Return the largest distance between two cameras, metres; 0 for one."""
    apart = [float(np.linalg.norm(a.centre_world() - b.centre_world())) for a, b in combinations(cameras, 2)]
    return max(apart, default=0.0)


def upward_axis(cameras: Sequence[Camera]) -> str:
    """Return which axis of the world points up in the pictures of all cameras; z if that is unclear.

    One camera may be tilted, and several may look down from above or stand on their sides; but they hardly all do so
    the same way.
    """
    upward = np.array([-camera.R_cam_world[:, 1].mean(axis=0) for camera in cameras])
    if len(cameras) < 2 or (upward[:, 2] > _MAX_UPRIGHT).any():
        return "z"
    common = {axis: float((upward @ np.array(rows, float)[2]).min()) for axis, rows in AXES.items()}
    axis = max(common, key=common.__getitem__)
    return axis if common[axis] > _MIN_COMMON else "z"


def upward_axis_warning(cameras: Sequence[Camera]) -> str:
    """Return what speaks against a world of cameras whose z axis points up; "" if nothing does."""
    axis = upward_axis(cameras)
    return "" if axis == "z" else f"all cameras are tilted as if the world's {axis} axis, not z, pointed up"
