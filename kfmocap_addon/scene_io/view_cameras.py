"""Views in Blender: camera objects with the footage as their background, and back."""

from __future__ import annotations

import contextlib
import json
import os
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

import bpy
import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import Rotation

from ...core.cameras.camera import Camera
from ...core.errors import CalibrationError
from ...core.numerics import rotations
from ...core.shot.footage import image_files
from ...core.shot.shot import View
from . import distortion, fcurves, footage_background, lossless

Array = NDArray[np.float64]

_FLIP = np.diag([1.0, -1.0, -1.0])  # Blender's cameras look along -z with y up, OpenCV's along z with y down
_FRAME, _DISTORTED = "kfmocap_frame", "kfmocap_lens"
_POSED = ("location", "rotation_quaternion", "rotation_euler", "scale")
_SAME = 1e-6  # metres, and differences of rotations: a camera that moves by less is fixed


def build_view(
    view: View,
    clip: bpy.types.MovieClip,
    slot: bpy.types.PropertyGroup,
    collection: bpy.types.Collection,
    *,
    first: int,
    frame_start: int,
) -> bpy.types.Object:
    """Build a camera object with its footage, and describe the view in its slot of the scene's properties.

    Parameters
    ----------
    clip : bpy.types.MovieClip
        The view's footage.
    slot : KFMocapView
    first : int
        First frame of the shot in the footage's count.
    frame_start : int
        Scene frame of shot frame 0.
    """
    camera = view.camera
    owner = _camera_object(camera.name, collection, clip)
    slot.name, slot.camera = camera.name, owner
    show_camera(slot, camera, frame_start)
    slot.offset, slot.fields = view.offset, view.fields
    footage_background.show_in_time(slot, first, frame_start)
    slot.sequence = view.footage.name if image_files(view.footage) is not None else ""
    slot.keypoints = "" if view.keypoints is None else _relative(view.keypoints, view.footage.parent)
    return owner


def build_camera(
    camera: Camera, collection: bpy.types.Collection, frame_start: int, clip: bpy.types.MovieClip | None = None
) -> bpy.types.Object:
    """Build a camera object, animated where the camera moves, with footage behind it where there is some.

    Parameters
    ----------
    frame_start : int
        Scene frame of the first pose of a moving camera.
    """
    owner = _camera_object(camera.name, collection, clip)
    _show_as(owner, camera, frame_start)
    return owner


def _camera_object(name: str, collection: bpy.types.Collection, clip: bpy.types.MovieClip | None) -> bpy.types.Object:
    data = bpy.data.cameras.new(name)
    data.display_size = 0.3  # metres: in the pictures of other cameras it shall not be in the way
    owner = bpy.data.objects.new(name, data)
    collection.objects.link(owner)
    if clip is not None:
        footage_background.show_behind(data, clip)
    return owner


def adopt(slot: bpy.types.PropertyGroup, owner: bpy.types.Object, scene: bpy.types.Scene) -> None:
    """Make a camera object with footage behind it a view, as it stands: whoever solved or placed it."""
    clip = footage_background.clip_behind(owner)
    frame = _frame_behind(scene, owner, clip)
    slot.name, slot.camera, slot.size, slot.aspect = owner.name, owner, frame.size, frame.aspect
    slot.distortions = "" if _built_lens(owner)[2] else owner[_DISTORTED]
    for background in owner.data.background_images:
        footage_background.undistort(background)
    slot.offset = scene.kfmocap.zero - clip.frame_start


def show_camera(slot: bpy.types.PropertyGroup, camera: Camera, frame_start: int) -> None:
    """Give a view's camera object and its footage the pose and the lens of a camera."""
    frame = _show_as(slot.camera, camera, frame_start)
    slot.size, slot.aspect = frame.size, frame.aspect
    slot.distortions = (
        "" if distortion.fits_brown_model(camera.distortions, camera.fisheye) else _packed_distortions(camera)
    )


def _show_as(owner: bpy.types.Object, camera: Camera, frame_start: int) -> distortion.Frame:
    """Give a camera object and the footage behind it the pose and the lens of a camera."""
    frame = distortion.set_lens(owner.data, camera)
    _place(owner, camera, frame_start)
    clip = footage_background.clip_behind(owner)
    if clip is not None:
        distortion.set_clip_lens(clip, camera)
    for name in ("matrix", "distortions", "R_cam_world", "t_cam_world"):
        lossless.keep(owner, f"kfmocap_{name}", getattr(camera, name))
    owner[_FRAME] = json.dumps([*frame.size, *frame.aspect])
    owner[_DISTORTED] = _packed_distortions(camera)
    return frame


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
    poses = _camera_poses(scene, list(owners), frame_start, length)
    return [_read_camera(scene, owner, *pose) for owner, pose in zip(owners, poses, strict=True)]


def _read_camera(scene: bpy.types.Scene, owner: bpy.types.Object, R_cam_world: Array, t_cam_world: Array) -> Camera:
    clip = footage_background.clip_behind(owner)
    frame = _frame_behind(scene, owner, clip)
    coefficients, fisheye, brown = _built_lens(owner)
    distortions = distortion.clip_distortions(clip) if clip is not None and brown else coefficients
    return _core_camera(owner.name, owner, frame, (R_cam_world, t_cam_world), distortions, fisheye)


def _built_lens(owner: bpy.types.Object) -> tuple[list[float], bool, bool]:
    """The distortion that a camera object was built with: OpenCV's coefficients, whether a fisheye's, and whether
    Blender's Brown model can hold it."""
    packed = json.loads(owner[_DISTORTED]) if _DISTORTED in owner else {"coefficients": [0.0] * 4, "fisheye": False}
    coefficients, fisheye = packed["coefficients"], packed["fisheye"]
    return coefficients, fisheye, distortion.fits_brown_model(coefficients, fisheye)


def _core_camera(
    name: str,
    owner: bpy.types.Object,
    frame: distortion.Frame,
    pose: tuple[Array, Array],
    distortions: ArrayLike,
    fisheye: bool,
) -> Camera:
    """A camera object as a camera; what was built here and did not change is exact."""
    R_cam_world, t_cam_world = pose
    return Camera.create(
        name,
        frame.size,
        lossless.recall(owner, "kfmocap_matrix", distortion.intrinsic_matrix(owner.data, frame), max(frame.size)),
        lossless.recall(owner, "kfmocap_R_cam_world", R_cam_world),
        lossless.recall(owner, "kfmocap_t_cam_world", t_cam_world, 1.0 + float(np.abs(t_cam_world).max())),
        lossless.recall(owner, "kfmocap_distortions", distortions, 1e-3),
        fisheye,
    )


def _frame_behind(
    scene: bpy.types.Scene, owner: bpy.types.Object, clip: bpy.types.MovieClip | None
) -> distortion.Frame:
    """Size and pixel aspect of the picture that a camera's lens refers to."""
    if _FRAME in owner:
        width, height, across, down = json.loads(owner[_FRAME])
        return distortion.Frame((width, height), (across, down))
    if clip is not None and min(clip.size) > 0:
        aspect = clip.tracking.camera.pixel_aspect
        return distortion.Frame(tuple(clip.size), (aspect, 1.0) if aspect >= 1 else (1.0, 1 / aspect))
    render = scene.render
    share = render.resolution_percentage / 100
    size = round(render.resolution_x * share), round(render.resolution_y * share)
    return distortion.Frame(size, (render.pixel_aspect_x, render.pixel_aspect_y))


def check_can_be_placed(slots: Iterable[bpy.types.PropertyGroup]) -> None:
    """See that the views' cameras stand where their own properties say.

    Raises
    ------
    CalibrationError
        A camera is moved by something else.
    """
    for slot in slots:
        if slot.camera.parent is not None or slot.camera.constraints:
            raise CalibrationError(
                "a parent or a constraint moves it",
                where=f"camera {slot.camera.name}",
                todo="bake its motion: Object > Animation > Bake Action, with Visual Keying and Clear Constraints",
            )


def _place(owner: bpy.types.Object, camera: Camera, frame_start: int) -> None:
    """Give an object a camera's pose: keyed on every frame where it moves, or was keyed before."""
    R = np.swapaxes(camera.R_cam_world, -1, -2) @ _FLIP
    centres = np.stack([camera.centre_world(i) for i in range(len(R))])
    quaternions = Rotation.from_matrix(R).as_quat()[:, [3, 0, 1, 2]]
    for i in range(1, len(R)):
        if quaternions[i] @ quaternions[i - 1] < 0:
            quaternions[i] = -quaternions[i]
    owner.rotation_mode = "QUATERNION"
    owner.location, owner.rotation_quaternion = centres[0], quaternions[0]
    if camera.moving or owner.animation_data is not None:
        bag = fcurves.ensure_channelbag(owner, owner.name)
        frames = frame_start + np.arange(len(R))
        for path, values in (("location", centres), ("rotation_quaternion", quaternions)):
            for k in range(values.shape[1]):
                curve = fcurves.ensure_fcurve(bag, path, k, "Object Transforms")
                fcurves.set_keys(curve, [fcurves.new_keys(frames, values[:, k], "KEYFRAME", "LINEAR")])


def read_views(scene: bpy.types.Scene, frame_start: int, length: int) -> tuple[View, ...]:
    """The views of a scene, in the order of its properties.

    Raises
    ------
    CalibrationError, FootageError
        If a camera or its footage is missing or cannot be one of ours.
    """
    slots = scene.kfmocap.views
    for slot in slots:
        if slot.camera is None or slot.camera.name not in scene.objects:
            raise CalibrationError("the camera object is gone from the scene", where=f"view {slot.name}")
        if not slot.is_calibrated:
            raise CalibrationError(
                "its camera is not calibrated",
                where=f"view {slot.name}",
                todo="import a calibration, calibrate with a wand, or place the camera by hand and tick Calibrated",
            )
    poses = _camera_poses(scene, [slot.camera for slot in slots], frame_start, length)
    return tuple(_read_view(slot, *pose) for slot, pose in zip(slots, poses, strict=True))


def _read_view(slot: bpy.types.PropertyGroup, R_cam_world: Array, t_cam_world: Array) -> View:
    clip = footage_background.background_clip(slot)
    frame = distortion.Frame(tuple(slot.size), tuple(slot.aspect))
    packed = json.loads(slot.distortions) if slot.distortions else {"fisheye": False}
    distortions = packed.get("coefficients") or distortion.clip_distortions(clip)
    pose = R_cam_world, t_cam_world
    camera = _core_camera(slot.name, slot.camera, frame, pose, distortions, packed["fisheye"])
    footage = footage_background.footage_path(slot)
    keypoints = Path(os.path.normpath(footage.parent / slot.keypoints)) if slot.keypoints else None
    return View(camera, footage, round(slot.offset, 5), slot.fields, keypoints)


def set_keypoints(slot: bpy.types.PropertyGroup, path: Path) -> None:
    """Give a view a detector's 2D keypoints, a file or a folder; its path is kept relative to the footage's.

    Raises
    ------
    FootageError
        The view's camera has no footage.
    """
    footage_background.background_clip(slot)
    slot.keypoints = _relative(path, footage_background.footage_path(slot).parent)


def is_built(owner: bpy.types.Object) -> bool:
    """Whether a camera object was built here from a calibration."""
    return _FRAME in owner


def _camera_poses(
    scene: bpy.types.Scene, cameras: list[bpy.types.Object], frame_start: int, length: int
) -> list[tuple[Array, Array]]:
    """World to camera rotations (N, 3, 3) and translations (N, 3) of every camera; N is 1 where it is fixed.

    However a camera is moved (keys, constraints, Blender's camera solver), it is evaluated on every frame.
    """
    if all(_stands_still(camera) for camera in cameras):
        frames = [scene.frame_current]
    else:
        frames = list(range(frame_start, frame_start + length))
    matrices = np.empty((len(frames), len(cameras), 4, 4))
    layer = _view_layer(scene, cameras)
    with _coming_back(scene) if len(frames) > 1 else contextlib.nullcontext():
        for i, frame in enumerate(frames):
            if len(frames) > 1:
                scene.frame_set(frame)
            layer.update()
            for c, camera in enumerate(cameras):
                matrices[i, c] = np.array(camera.evaluated_get(layer.depsgraph).matrix_world)
    return [_cv_poses(matrices[:, c]) for c in range(len(cameras))]


@contextlib.contextmanager
def _coming_back(scene: bpy.types.Scene) -> Iterator[None]:
    """Other frames are visited in the block; then the frame is shown again, with poses that nobody has keyed yet."""
    before = scene.frame_current, scene.frame_subframe
    bones = [bone for thing in scene.objects if thing.pose for bone in thing.pose.bones]
    posed = [(bone, name, getattr(bone, name).copy()) for bone in bones for name in _POSED]
    try:
        yield
    finally:
        scene.frame_set(before[0], subframe=before[1])
        for bone, name, value in posed:
            setattr(bone, name, value)


def _stands_still(camera: bpy.types.Object) -> bool:
    return camera.animation_data is None and camera.parent is None and not camera.constraints


def _view_layer(scene: bpy.types.Scene, cameras: list[bpy.types.Object]) -> bpy.types.ViewLayer:
    """A view layer that evaluates all the cameras."""
    for layer in scene.view_layers:
        layer.update()  # an object linked just now is not in `layer.objects` before
        if all(camera.name in layer.objects for camera in cameras):
            return layer
    raise CalibrationError(
        "no view layer holds all the cameras of the shot",
        where=f"scene {scene.name}",
        todo="switch the cameras' collection on",
    )


def _cv_poses(matrices: Array) -> tuple[Array, Array]:
    """OpenCV's poses of Blender's camera matrices (N, 4, 4); one where they are all the same."""
    spread = np.abs(matrices - matrices[:1]).max()
    matrices = matrices[:1] if spread < _SAME else matrices
    R = np.swapaxes(rotations.orthonormal(matrices[:, :3, :3]) @ _FLIP, -1, -2)
    return R, -np.einsum("nij,nj->ni", R, matrices[:, :3, 3])


def _packed_distortions(camera: Camera) -> str:
    return json.dumps({"coefficients": camera.distortions.tolist(), "fisheye": camera.fisheye})


def _relative(path: Path, folder: Path) -> str:
    """The path as seen from the folder; as it is where there is no way, as between drives."""
    with contextlib.suppress(ValueError):
        return os.path.relpath(path, folder)
    return str(path)
