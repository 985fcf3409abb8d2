"""The views of a shot: camera objects with the footage as their background, and back."""

from __future__ import annotations

import contextlib
import json
import os
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import bpy

from ....core.cameras.camera import Camera
from ....core.errors import CalibrationError, FootageError
from ....core.numerics.arrays import Array
from ....core.shot.footage_files.image_sequences import image_files
from ....core.shot.shot import Shot, View
from ....core.shot.shot_spec import ViewSpec
from . import camera_poses, distortion, footage_background, scene_cameras
from .view_gaps import packed_gaps

if TYPE_CHECKING:
    from ....core.fitting.checks.view_findings import ViewFinding


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
    owner = scene_cameras.new_camera_object(camera.name, collection, clip)
    slot.name, slot.camera = camera.name, owner
    show_camera(slot, camera, frame_start)
    slot.offset, slot.fields, slot.every = view.offset, view.fields, view.every
    slot.found_gaps = packed_gaps(view.gaps)
    footage_background.show_in_time(slot, first, frame_start)
    slot.sequence = view.footage.name if image_files(view.footage) is not None else ""
    slot.keypoints = "" if view.keypoints is None else _relative(view.keypoints, view.footage.parent)
    return owner


def show_camera(slot: bpy.types.PropertyGroup, camera: Camera, frame_start: int) -> None:
    """Set pose and lens of a view's camera object, and the lens of its footage, to those of a camera."""
    frame = scene_cameras.show_camera_on(slot.camera, camera, frame_start)
    slot.size, slot.aspect, slot.misfit = frame.size, frame.aspect, ""
    slot.distortions = (
        ""
        if distortion.fits_brown_model(camera.distortions, camera.fisheye)
        else scene_cameras.packed_distortions(camera)
    )


def show_turns(scene: bpy.types.Scene, shot: Shot, turns: Sequence[Array | None]) -> bool:
    """Give the cameras of a scene's views that were found to turn their poses on every frame; returns whether there
    were any. What a parent or a constraint moves is left alone.

    Parameters
    ----------
    shot : Shot
        Its cameras have these poses.
    turns : sequence of (ndarray or None)
        Per view, see `core.tracking.results.track_result.TrackResult`.
    """
    found = {view.camera.name: view.camera for view, own in zip(shot.views, turns, strict=False) if own is not None}
    placed = [slot for slot in scene.kfmocap.views if slot.name in found and not camera_poses.is_held(slot.camera)]
    for slot in placed:
        show_camera(slot, found[slot.name], scene.kfmocap.frame_start)
    return bool(placed)


def show_fits(slots: Iterable[bpy.types.PropertyGroup], fits: Sequence[ViewFinding]) -> list[str]:
    """Show which views' cameras do not fit; returns what is to be said about them, and which tool may help."""
    off = [fit for fit in fits if fit.off]
    offsets = {fit.camera: fit.offset for fit in off if fit.by == "movement"}
    for slot in slots:
        slot.misfit = "; ".join(fit.brief for fit in off if fit.camera == slot.name)
        offset = offsets.get(slot.name)
        slot.fitting_offset = "" if offset is None else f"{offset:g}"
    return [f"{fit.summary}. {_advice(fit)}" if _advice(fit) else fit.summary for fit in off]


def _advice(fit: ViewFinding) -> str:
    if fit.by in ("keypoints", "key poses"):
        return "Refine Cameras may help"
    return "Use Offset in Footage and Cameras takes it" if fit.by == "movement" and fit.offset is not None else ""


def adopt(slot: bpy.types.PropertyGroup, owner: bpy.types.Object, scene: bpy.types.Scene) -> None:
    """Make a camera object with footage behind it a view, as it stands: whoever solved or placed it."""
    clip = footage_background.clip_behind(owner)
    frame = scene_cameras.frame_behind(scene, owner, clip)
    slot.name, slot.camera, slot.size, slot.aspect = owner.name, owner, frame.size, frame.aspect
    slot.distortions = "" if scene_cameras.built_distortion(owner)[2] else owner[scene_cameras.DISTORTED]
    for background in owner.data.background_images:
        footage_background.undistort(background)
    slot.offset = scene.kfmocap.zero - clip.frame_start + clip.frame_offset


def read_views(scene: bpy.types.Scene, frame_start: int, length: int) -> tuple[View, ...]:
    """Return the views of a scene, in the order of its properties.

    Raises
    ------
    CalibrationError, FootageError
        If a camera or its footage is missing or cannot be one of ours.
    """
    slots = scene.kfmocap.views
    for slot in slots:
        if not slot.has_camera:
            raise CalibrationError("the camera object is gone from the scene", where=f"view {slot.name}")
        if not slot.is_calibrated:
            raise CalibrationError(
                "its camera is not calibrated",
                where=f"view {slot.name}",
                todo="import a calibration, calibrate with a wand or from a performer, or place the camera by hand and "
                "tick Calibrated",
            )
        _refuse_moved_clip(scene, slot)
    poses = camera_poses.read_poses(scene, [slot.camera for slot in slots], frame_start, length)
    lenses = [camera_poses.read_lens(slot.camera, frame_start, length) for slot in slots]
    return tuple(_read_view(*one) for one in zip(slots, poses, lenses, strict=True))


def _refuse_moved_clip(scene: bpy.types.Scene, slot: bpy.types.PropertyGroup) -> None:
    """Raise a FootageError if key poses were not set over the frames that would be tracked."""
    moved = footage_background.moved_by(slot, scene.kfmocap.first, scene.kfmocap.frame_start)
    if moved:
        frames = f"{abs(moved)} frame{'s' if abs(moved) > 1 else ''} {'earlier' if moved > 0 else 'later'}"
        raise FootageError(
            f"its pictures are shown {frames} than its Offset says, as its movie clip was moved in Blender",
            where=f"view {slot.name}",
            todo=f"enter the Offset {footage_background.moved_offset(slot, moved):g} in Look Through > View",
        )


def set_keypoints(slot: bpy.types.PropertyGroup, path: Path) -> None:
    """Set a view's 2D keypoints, a file or a folder; the path is stored relative to the footage's.

    Raises
    ------
    FootageError
        The view's camera has no footage.
    """
    footage_background.background_clip(slot)
    slot.keypoints = _relative(path, footage_background.footage_path(slot).parent)


def read_specs(scene: bpy.types.Scene) -> tuple[ViewSpec, ...]:
    """Return the views of a scene as a shot file names them: whatever is known of their cameras.

    Raises
    ------
    FootageError
        A view's footage is missing.
    """
    return tuple(_read_spec(slot) for slot in scene.kfmocap.views)


def known_lenses(scene: bpy.types.Scene) -> dict[str, Camera]:
    """Return the cameras of those views whose lenses are known, by their names: wherever they stand."""
    slots = [slot for slot in scene.kfmocap.views if slot.lens_known]
    poses = camera_poses.read_poses(scene, [slot.camera for slot in slots], scene.frame_current, 1)
    return {slot.name: _read_camera(slot, pose, None) for slot, pose in zip(slots, poses, strict=True)}


def _read_view(slot: bpy.types.PropertyGroup, pose: tuple[Array, Array], lens: Array | None) -> View:
    spec = _read_spec(slot)
    camera = _read_camera(slot, pose, lens)
    return View(camera, spec.footage, spec.offset, spec.fields, spec.keypoints, spec.gaps, every=slot.every)


def _read_spec(slot: bpy.types.PropertyGroup) -> ViewSpec:
    footage_background.background_clip(slot)
    footage = footage_background.footage_path(slot)
    keypoints = Path(os.path.normpath(footage.parent / slot.keypoints)) if slot.keypoints else None
    where = f"view {slot.name}"
    return ViewSpec(
        camera=slot.name,
        footage=footage,
        offset=round(slot.offset, 5),
        fields=slot.fields,
        keypoints=keypoints,
        where=where,
        gaps=slot.gaps,
        every=slot.every,
    )


def _read_camera(slot: bpy.types.PropertyGroup, pose: tuple[Array, Array], lens: Array | None) -> Camera:
    frame = distortion.Frame(tuple(slot.size), tuple(slot.aspect))
    packed = json.loads(slot.distortions) if slot.distortions else {"fisheye": False}
    distortions = packed.get("coefficients") or distortion.clip_distortions(footage_background.background_clip(slot))
    return scene_cameras.core_camera(
        slot.name, slot.camera, frame, pose, distortions=distortions, fisheye=packed["fisheye"], lens=lens
    )


def _relative(path: Path, folder: Path) -> str:
    """Return the path as seen from the folder; as it is where there is no way, as between drives."""
    with contextlib.suppress(ValueError):
        return os.path.relpath(path, folder)
    return str(path)
