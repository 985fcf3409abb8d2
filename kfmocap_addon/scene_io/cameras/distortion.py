"""A camera's intrinsics as Blender knows them, and lens distortion as Blender's movie clips know it.

Blender measures shifts from the frame's middle in units of its width (or height, by the sensor fit); a
pixel's centre lies half a pixel inside the frame, in OpenCV at an integer.
"""

from __future__ import annotations

from dataclasses import dataclass

import bpy
import numpy as np
from numpy.typing import ArrayLike

from ....core.cameras.brown_conrady import brown_model
from ....core.cameras.camera import Camera
from ....core.errors import CalibrationError
from ....core.numerics.arrays import Array

Pair = tuple[float, float]

SENSOR_WIDTH = 36.0  # mm; the lens follows from it, so that the number itself is free


@dataclass(frozen=True)
class Frame:
    """The picture that a camera's intrinsics refer to, as a scene's render settings give it.

    Attributes
    ----------
    size : tuple of int
        Width and height, pixels.
    aspect : tuple of float
        Width and height of a pixel, the smaller one 1.
    """

    size: tuple[int, int]
    aspect: Pair


def frame_of(camera: Camera) -> Frame:
    """Size and pixel aspect that show a camera's footage as it is."""
    fx, fy = camera.matrix[0, 0], camera.matrix[1, 1]
    return Frame(camera.size, (1.0, fx / fy) if fx >= fy else (fy / fx, 1.0))


def set_lens(data: bpy.types.Camera, camera: Camera) -> Frame:
    """Set a Blender camera's intrinsics to those of a core camera; valid for the frame returned."""
    K, (width, height) = camera.matrix, camera.size
    if abs(K[0, 1]) > 1e-6 * K[0, 0]:
        raise CalibrationError(
            f"the matrix has a skew of {K[0, 1]:g} px, which Blender's cameras cannot have",
            where=f"camera {camera.name}",
        )
    frame = frame_of(camera)
    data.type, data.sensor_fit, data.sensor_width = "PERSP", "HORIZONTAL", SENSOR_WIDTH
    data.lens = K[0, 0] * SENSOR_WIDTH / width
    data.shift_x = -((K[0, 2] + 0.5) - width / 2) / width
    data.shift_y = ((K[1, 2] + 0.5) - height / 2) * (frame.aspect[1] / frame.aspect[0]) / width
    return frame


def intrinsic_matrix(data: bpy.types.Camera, frame: Frame, lens: float | None = None) -> Array:
    """OpenCV's matrix (3, 3), pixels, of a Blender camera of any sensor fit, with its focal length as it is now or
    another one, millimetres; inverse of `set_lens`.
    """
    if data.type != "PERSP":
        raise CalibrationError("the camera is not a perspective one", where=f"camera {data.name}")
    width, height = frame.size
    ratio = frame.aspect[1] / frame.aspect[0]
    fit = data.sensor_fit
    if fit == "AUTO":
        fit = "HORIZONTAL" if width >= height * ratio else "VERTICAL"
    sensor = data.sensor_height if data.sensor_fit == "VERTICAL" else data.sensor_width
    unit = width if fit == "HORIZONTAL" else height * ratio  # what one sensor spans, in pixel widths
    fx = (data.lens if lens is None else lens) / sensor * unit
    cx = width / 2 - data.shift_x * unit - 0.5
    cy = height / 2 + data.shift_y * unit / ratio - 0.5
    return np.array([[fx, 0.0, cx], [0.0, fx / ratio, cy], [0.0, 0.0, 1.0]])


def fits_brown_model(distortions: ArrayLike, fisheye: bool) -> bool:
    """Whether Blender's Brown model can hold a camera's distortion: OpenCV's first five coefficients."""
    return not fisheye and not np.any(np.asarray(distortions)[5:])


def set_clip_lens(clip: bpy.types.MovieClip, camera: Camera) -> None:
    """Set a movie clip's intrinsics, and the lens distortion that is removed from its footage.

    Where Blender has no model for it, that is the nearest of those it has.
    """
    K, height = camera.matrix, camera.size[1]
    tracking = clip.tracking.camera
    tracking.sensor_width = SENSOR_WIDTH
    tracking.pixel_aspect = K[1, 1] / K[0, 0]  # a pixel's width over its height
    clip.display_aspect = frame_of(camera).aspect  # by it the footage is fitted before cameras
    tracking.focal_length_pixels = K[0, 0]
    tracking.principal_point_pixels = (K[0, 2] + 0.5, height - (K[1, 2] + 0.5))
    tracking.distortion_model = "BROWN"
    brown = brown_model(camera)
    tracking.brown_k1, tracking.brown_k2, tracking.brown_k3, tracking.brown_k4 = brown.radial
    p1, p2 = brown.tangential
    tracking.brown_p1, tracking.brown_p2 = p2, -p1  # libmv's order; Blender's y goes up


def clip_distortions(clip: bpy.types.MovieClip) -> Array:
    """OpenCV's coefficients (k1, k2, p1, p2, k3) of a movie clip's lens."""
    t = clip.tracking.camera
    if t.distortion_model == "BROWN" and t.brown_k4 == 0.0:
        return np.array([t.brown_k1, t.brown_k2, -t.brown_p2, t.brown_p1, t.brown_k3])
    if t.distortion_model == "POLYNOMIAL":
        return np.array([t.k1, t.k2, 0.0, 0.0, t.k3])
    raise CalibrationError(
        f"the lens distortion model {t.distortion_model} is not supported",
        where=f"movie clip {clip.name}",
        todo="use Brown (without K4) or Polynomial",
    )
