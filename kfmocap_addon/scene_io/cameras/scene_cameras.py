"""Camera objects as the core's cameras, and back."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import bpy
import numpy as np
from numpy.typing import ArrayLike

from ....core.cameras.camera import Camera
from ....core.cameras.lens_turns import zooming
from ....core.numerics.arrays import Array
from .. import lossless
from . import camera_poses, distortion, footage_background

_FRAME, DISTORTED = "kfmocap_frame", "kfmocap_lens"
"""Custom properties of a camera object: size and pixel aspect of its footage; distortion as JSON."""


def build_camera(
    camera: Camera, collection: bpy.types.Collection, frame_start: int, clip: bpy.types.MovieClip | None
) -> bpy.types.Object:
    """Build a camera object, animated where the camera moves, with footage behind it where there is some.

    Parameters
    ----------
    frame_start : int
        Scene frame of the first pose of a moving camera.
    """
    owner = new_camera_object(camera.name, collection, clip)
    show_camera_on(owner, camera, frame_start)
    return owner


def read_cameras(
    scene: bpy.types.Scene, owners: Sequence[bpy.types.Object], frame_start: int, length: int
) -> list[Camera]:
    """Cameras of camera objects, however they came: built here, placed by hand, or solved by Blender's own tracker.

    The picture that a camera's lens refers to is the footage behind it, or the scene's render size. Lens distortion
    is that of the footage's movie clip. A camera that is animated has a pose for each of the frames.

    Parameters
    ----------
    owners : sequence of bpy.types.Object
        Camera objects of the scene.
    frame_start, length : int
        Scene frames of a moving camera's poses.

    Raises
    ------
    CalibrationError
        If a camera cannot be one of ours, or no view layer shows them all.
    """
    if not owners:
        return []
    poses = camera_poses.read_poses(scene, list(owners), frame_start, length)
    lenses = [camera_poses.read_lens(owner, frame_start, length) for owner in owners]
    return [_read_camera(scene, *one) for one in zip(owners, poses, lenses, strict=True)]


def is_built(owner: bpy.types.Object) -> bool:
    """Whether a camera object was built here from a calibration."""
    return _FRAME in owner


def new_camera_object(
    name: str, collection: bpy.types.Collection, clip: bpy.types.MovieClip | None
) -> bpy.types.Object:
    """Build a camera object without a pose, with footage behind it where there is some."""
    data = bpy.data.cameras.new(name)
    data.display_size = 0.3  # metres: in the pictures of other cameras it shall not be in the way
    owner = bpy.data.objects.new(name, data)
    collection.objects.link(owner)
    if clip is not None:
        footage_background.show_behind(data, clip)
    return owner


def show_camera_on(owner: bpy.types.Object, camera: Camera, frame_start: int) -> distortion.Frame:
    """Set pose and lens of a camera object, and the lens of its footage, to those of a camera."""
    frame = distortion.set_lens(owner.data, camera)
    camera_poses.place_camera(owner, camera, frame_start)
    clip = footage_background.clip_behind(owner)
    if clip is not None:
        distortion.set_clip_lens(clip, camera)
    for name in ("matrix", "distortions", "R_cam_world", "t_cam_world"):
        lossless.keep(owner, f"kfmocap_{name}", getattr(camera, name))
    lossless.keep(owner, "kfmocap_zooms", [] if camera.zooms is None else camera.zooms)
    owner[_FRAME] = json.dumps([*frame.size, *frame.aspect])
    owner[DISTORTED] = packed_distortions(camera)
    return frame


def _read_camera(
    scene: bpy.types.Scene, owner: bpy.types.Object, pose: tuple[Array, Array], lens: Array | None
) -> Camera:
    clip = footage_background.clip_behind(owner)
    frame = frame_behind(scene, owner, clip)
    coefficients, fisheye, brown = built_distortion(owner)
    distortions = distortion.clip_distortions(clip) if clip is not None and brown else coefficients
    return core_camera(owner.name, owner, frame, pose, distortions=distortions, fisheye=fisheye, lens=lens)


def built_distortion(owner: bpy.types.Object) -> tuple[list[float], bool, bool]:
    """Return the distortion that a camera object was built with: OpenCV's coefficients, whether a fisheye's, and
    whether Blender's Brown model can hold it.
    """
    packed: dict[str, Any] = {"coefficients": [0.0] * 4, "fisheye": False}
    if DISTORTED in owner:
        packed = json.loads(owner[DISTORTED])
    coefficients, fisheye = packed["coefficients"], packed["fisheye"]
    return coefficients, fisheye, distortion.fits_brown_model(coefficients, fisheye)


def core_camera(
    name: str,
    owner: bpy.types.Object,
    frame: distortion.Frame,
    pose: tuple[Array, Array],
    *,
    distortions: ArrayLike,
    fisheye: bool,
    lens: Array | None,
) -> Camera:
    """Return a camera object as a camera; what was built here and did not change is exact. `lens` is its focal length,
    millimetres, shape (N,), if that has keys: one, or one per frame if it zooms. The matrix then has that with which it
    was built, or the first one: on whichever frame the scene is, the camera is the same.
    """
    R_cam_world, t_cam_world = pose
    zooms, matrix = None, distortion.intrinsic_matrix(owner.data, frame, None if lens is None else float(lens[0]))
    if lens is not None and len(lens) > 1:
        zooms = lens / lens[0]
        R_cam_world = np.broadcast_to(R_cam_world, (len(lens), 3, 3))
        t_cam_world = np.broadcast_to(t_cam_world, (len(lens), 3))
        if "kfmocap_matrix" in owner:  # that of another frame than the first
            first = matrix[0, 0] / lossless.stored(owner["kfmocap_matrix"])[0, 0]
            matrix, zooms = matrix @ zooming(1 / first), lossless.recall(owner, "kfmocap_zooms", first * zooms)
    camera = Camera.create(
        name,
        frame.size,
        lossless.recall(owner, "kfmocap_matrix", matrix, max(frame.size)),
        lossless.recall(owner, "kfmocap_R_cam_world", R_cam_world),
        lossless.recall(owner, "kfmocap_t_cam_world", t_cam_world, 1.0 + float(np.abs(t_cam_world).max())),
        distortions=lossless.recall(owner, "kfmocap_distortions", distortions, 1e-3),
        fisheye=fisheye,
    )
    return replace(camera, zooms=zooms)


def frame_behind(scene: bpy.types.Scene, owner: bpy.types.Object, clip: bpy.types.MovieClip | None) -> distortion.Frame:
    """Size and pixel aspect of the picture that a camera's lens refers to."""
    if _FRAME in owner:
        width, height, across, down = json.loads(owner[_FRAME])
        return distortion.Frame((width, height), (across, down))
    if clip is not None and min(clip.size) > 0:
        aspect = clip.tracking.camera.pixel_aspect
        return distortion.Frame((clip.size[0], clip.size[1]), (aspect, 1.0) if aspect >= 1 else (1.0, 1 / aspect))
    render = scene.render
    share = render.resolution_percentage / 100
    size = round(render.resolution_x * share), round(render.resolution_y * share)
    return distortion.Frame(size, (render.pixel_aspect_x, render.pixel_aspect_y))


def packed_distortions(camera: Camera) -> str:
    """Return the distortion of a camera as JSON."""
    return json.dumps({"coefficients": camera.distortions.tolist(), "fisheye": camera.fisheye})
