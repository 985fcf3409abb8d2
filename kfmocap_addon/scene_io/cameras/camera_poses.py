"""Poses of camera objects: written as location, rotation and keys, read as Blender evaluates them; keys of a lens."""

from __future__ import annotations

import contextlib
from collections.abc import Iterable

import bpy
import numpy as np
from mathutils import Matrix, Quaternion, Vector
from scipy.spatial.transform import Rotation

from ....core.cameras.camera import Camera
from ....core.errors import CalibrationError
from ....core.numerics import rotations
from ....core.numerics.arrays import Array
from .. import fcurves
from ..visited_frames import same_time_and_poses

_FLIP = np.diag([1.0, -1.0, -1.0])  # Blender's cameras look along -z with y up, OpenCV's along z with y down


_SAME = 1e-6  # metres, and differences of rotations: a camera that moves by less is fixed


def place_camera(owner: bpy.types.Object, camera: Camera, frame_start: int) -> None:
    """Set an object's pose to a camera's, with keys on every frame if the camera moves or the object had keys."""
    R = np.swapaxes(camera.R_cam_world, -1, -2) @ _FLIP
    centres = np.stack([camera.centre_world(i) for i in range(len(R))])
    quaternions = Rotation.from_matrix(R).as_quat()[:, [3, 0, 1, 2]]
    for i in range(1, len(R)):
        if quaternions[i] @ quaternions[i - 1] < 0:
            quaternions[i] = -quaternions[i]
    owner.rotation_mode = "QUATERNION"
    owner.location, owner.rotation_quaternion = centres[0], quaternions[0]
    frames = frame_start + np.arange(len(R))
    if camera.moving or owner.animation_data is not None:
        bag = fcurves.ensure_channelbag(owner, owner.name)
        for path, values in (("location", centres), ("rotation_quaternion", quaternions)):
            for k in range(values.shape[1]):
                curve = fcurves.ensure_fcurve(bag, path, k, "Object Transforms")
                fcurves.set_keys(curve, [fcurves.new_keys(frames, values[:, k], "KEYFRAME", "LINEAR")])
    if camera.zooms is not None or _lens_curve(owner) is not None:
        lens = owner.data.lens * (np.ones(len(R)) if camera.zooms is None else camera.zooms)
        curve = fcurves.ensure_fcurve(fcurves.ensure_channelbag(owner.data, owner.name), "lens", 0, "")
        fcurves.set_keys(curve, [fcurves.new_keys(frames, lens, "KEYFRAME", "LINEAR")])


def read_lens(camera: bpy.types.Object, frame_start: int, length: int) -> Array | None:
    """Return the focal length of a camera on each of some scene frames, millimetres, shape (N,), by its keys: one where
    it is the same on all; None if it has no keys.
    """
    curve = _lens_curve(camera)
    if curve is None or curve.mute:
        return None
    lens = np.array([curve.evaluate(frame) for frame in range(frame_start, frame_start + length)])
    return lens[:1] if np.ptp(lens) < _SAME * lens.max() else lens


def _lens_curve(camera: bpy.types.Object) -> bpy.types.FCurve | None:
    bag = fcurves.find_channelbag(camera.data)
    return None if bag is None else bag.fcurves.find("lens")


def read_poses(
    scene: bpy.types.Scene, cameras: list[bpy.types.Object], frame_start: int, length: int
) -> list[tuple[Array, Array]]:
    """World to camera rotations (N, 3, 3) and translations (N, 3) of every camera; N is 1 where it is fixed.

    However a camera is moved (keys, constraints, Blender's camera solver), it is evaluated on every frame: of one that
    its own keys alone move, the curves; for all others the scene goes through the frames.

    Raises
    ------
    CalibrationError
        No view layer holds all cameras, or the scale of one mirrors it.
    """
    frames = list(range(frame_start, frame_start + length))
    followed = [_along_curves(camera, frames) for camera in cameras]
    if all(_stands_still(camera) or keyed is not None for camera, keyed in zip(cameras, followed, strict=True)):
        frames = [scene.frame_current]
    matrices = np.empty((len(frames), len(cameras), 4, 4))
    layer = _view_layer(scene, cameras)
    with same_time_and_poses(scene) if len(frames) > 1 else contextlib.nullcontext():
        for i, frame in enumerate(frames):
            if len(frames) > 1:
                scene.frame_set(frame)
            layer.update()
            for c, camera in enumerate(cameras):
                matrices[i, c] = np.array(camera.evaluated_get(layer.depsgraph).matrix_world)
    moved = [matrices[:, c] if keyed is None else keyed for c, keyed in enumerate(followed)]
    for camera, placed in zip(cameras, moved, strict=True):
        if (np.linalg.det(placed[:, :3, :3]) <= 0).any():
            todo = "make its scale, and that of what it hangs on, positive; mirror the footage itself if it is mirrored"
            raise CalibrationError("its scale mirrors or flattens it", where=f"camera {camera.name}", todo=todo)
    return [_cv_poses(placed) for placed in moved]


def _stands_still(camera: bpy.types.Object) -> bool:
    return camera.animation_data is None and camera.parent is None and not camera.constraints


def _along_curves(camera: bpy.types.Object, frames: list[int]) -> Array | None:
    """Return the matrices (F, 4, 4) of a camera on scene frames by its curves; None where more than these may move
    it.
    """
    data, bag = camera.animation_data, fcurves.find_channelbag(camera)
    if bag is None or camera.parent is not None or camera.constraints or camera.rotation_mode != "QUATERNION":
        return None
    if data.drivers or data.nla_tracks or (data.action_influence, data.action_blend_type) != (1.0, "REPLACE"):
        return None
    if len(data.action.layers) > 1 or len(data.action.layers[0].strips) > 1 or _has_delta(camera):
        return None
    paths = {"location": np.array(camera.location), "rotation_quaternion": np.array(camera.rotation_quaternion)}
    values = {path: np.tile(value, (len(frames), 1)) for path, value in paths.items()}
    for curve in bag.fcurves:
        if curve.data_path not in values or curve.mute or (curve.group is not None and curve.group.mute):
            return None
        values[curve.data_path][:, curve.array_index] = [curve.evaluate(frame) for frame in frames]
    places, turns = (values[path].tolist() for path in paths)
    scale = camera.scale
    return np.array(
        [Matrix.LocRotScale(Vector(p), Quaternion(q).normalized(), scale) for p, q in zip(places, turns, strict=True)]
    )


def _has_delta(camera: bpy.types.Object) -> bool:
    """Whether a camera is moved by more than its location, rotation and scale."""
    deltas = camera.delta_location, camera.delta_rotation_quaternion, camera.delta_scale
    rest = (0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0), (1.0, 1.0, 1.0)
    return any(not np.array_equal(np.array(delta), still) for delta, still in zip(deltas, rest, strict=True))


def _view_layer(scene: bpy.types.Scene, cameras: list[bpy.types.Object]) -> bpy.types.ViewLayer:
    """Return a view layer that evaluates all the cameras."""
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


def is_held(camera: bpy.types.Object) -> bool:
    """Whether a camera is moved by something else than its own properties."""
    return camera.parent is not None or bool(camera.constraints)


def check_can_be_placed(slots: Iterable[bpy.types.PropertyGroup]) -> None:
    """Check that nothing but their own properties moves the views' cameras.

    Raises
    ------
    CalibrationError
        A camera is moved by something else.
    """
    for slot in slots:
        if is_held(slot.camera):
            raise CalibrationError(
                "a parent or a constraint moves it",
                where=f"camera {slot.camera.name}",
                todo="bake its motion: Object > Animation > Bake Action, with Visual Keying and Clear Constraints",
            )
