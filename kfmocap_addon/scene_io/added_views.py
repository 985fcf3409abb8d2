"""Adding views to a scene: footage first, and its camera's calibration when there is one."""

from __future__ import annotations

import contextlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path

import bpy
import numpy as np

from ...core.cameras.camera import Camera
from ...core.errors import CalibrationError, FootageError, ShotError, located
from ...core.shot.footage import Footage, probe
from ...core.shot.footage_faults.footage_checks import camera_at_size, frames_for_each
from ...core.shot.footage_faults.footage_times import video_rate
from ...core.shot.footage_files.image_sequences import footage_of
from ...core.shot.name_matching import footage_name, paired
from ...core.shot.shot import View
from . import scene, solved_cameras
from .cameras import camera_poses, footage_background, scene_cameras, view_cameras

_USUAL_FOCAL = 1.1
"""Focal length of a camera about which nothing is known, relative to the longer side of its picture."""
_EQUAL_RATE = 1e-5
"""Relative difference up to which two frame rates of a file are rounded differently at most."""
_UNNAMED = "shot"
_STARTUP_CUBE = "Cube"
_CORNERS = set(product((-1.0, 1.0), repeat=3))
"""Of the cube that Blender starts with, metres."""


@dataclass(frozen=True)
class Calibrated:
    """Names of the views that were calibrated, and of those left without a camera."""

    views: tuple[str, ...]
    left: tuple[str, ...]


def add_footage(current: bpy.types.Scene, files: Sequence[Path]) -> list[str]:
    """Add views of footage, each with an uncalibrated camera.

    The first footage of a scene determines the scene's frame rate, and the shot's frames and name.

    Parameters
    ----------
    files : sequence of Path
        Videos, and images of sequences.

    Returns
    -------
    list of str
        Names of the new views.

    Raises
    ------
    FootageError
        A file cannot be read, or the scene has a view of it already; nothing is added then.
    """
    paths = footage_of(files)
    if not paths:
        raise FootageError("no file is chosen", todo="choose videos, or the images of a sequence")
    known = {footage_background.footage_path(slot) for slot in current.kfmocap.views}
    for path in paths:
        if path in known:
            raise FootageError("the scene shows this footage already", where=str(path))
    probed = [probe(path) for path in paths]
    clips = scene.load_clips(paths)
    probed = [_with_missing(footage, clip) for footage, clip in zip(probed, clips, strict=True)]
    if not current.kfmocap.views:
        _begin_shot(current, probed)
    collection = scene.ensure_collection(current, "Views")
    names = []
    for footage, clip in zip(probed, clips, strict=True):
        slots = current.kfmocap.views
        camera = _unknown_camera(scene.free_name(footage_name(footage.path), slots), footage.size, len(slots))
        properties, slot = current.kfmocap, slots.add()
        view_cameras.build_view(
            View(camera, footage.path, every=_every(current, footage)),
            clip,
            slot,
            collection,
            first=properties.first,
            frame_start=properties.frame_start,
        )
        slot.calibrated = slot.lens_known = False
        names.append(slot.name)
    if current.camera is None or not any(slot.camera == current.camera for slot in current.kfmocap.views):
        footage_background.look_through(current, current.kfmocap.views[0])
    footage_background.refresh(current)
    return names


def _with_missing(footage: Footage, clip: bpy.types.MovieClip) -> Footage:
    """Return footage with the rate and number of frames that it would have if none was missing by their times.

    Files state their mean rate, as do phones that skip frames; Blender shows frames by their times at the usual rate.
    """
    if clip.source != "MOVIE" or abs(clip.fps - footage.fps) < _EQUAL_RATE * footage.fps:
        return footage
    rate = video_rate(footage.path, footage.count)
    if rate is None or not rate.missing:
        return footage
    missing = sum(count for _, count in rate.missing)
    return replace(footage, fps=round(rate.rate, 3), count=footage.count + missing)


def _every(current: bpy.types.Scene, footage: Footage) -> int:
    """Return how many frames of footage there are for each of the scene, if that is a whole number; otherwise 1."""
    return frames_for_each(footage.fps, scene.frame_rate(current)) or 1


def hide_startup_cube(current: bpy.types.Scene) -> str:
    """Hide the cube that Blender starts with, if it is as Blender made it: it would stand in front of the footage.

    Returns
    -------
    str
        Its name, empty where there is none.
    """
    cube: bpy.types.Object | None = current.objects.get(_STARTUP_CUBE)
    if cube is None or not _is_startup_cube(cube):
        return ""
    layers = [layer for layer in current.view_layers if cube.name in layer.objects]
    shown = [layer for layer in layers if not cube.hide_get(view_layer=layer)]
    for layer in shown:
        cube.hide_set(True, view_layer=layer)
    return cube.name if shown else ""


def _is_startup_cube(thing: bpy.types.Object) -> bool:
    if thing.type != "MESH" or len(thing.data.vertices) != len(_CORNERS):
        return False
    changed = thing.parent or thing.animation_data or thing.modifiers or thing.children
    corners = {tuple(vertex.co) for vertex in thing.data.vertices}
    return not changed and corners == _CORNERS and bool(np.array_equal(np.array(thing.matrix_basis), np.eye(4)))


def _begin_shot(current: bpy.types.Scene, probed: Sequence[Footage]) -> None:
    properties = current.kfmocap
    scene.set_rate(current, next((footage.fps for footage in probed if footage.fps > 0), None))
    saved = Path(bpy.data.filepath).stem
    properties.shot = properties.shot or saved or _folder_name(probed[0].path) or _UNNAMED
    properties.zero, properties.first = max(current.frame_start, 0), 0
    properties.last = max(min(footage.count for footage in probed) - 1, 0)
    current.frame_set(properties.zero)


def _folder_name(footage: Path) -> str:
    """Return the name of the shot's folder: the footage's, or the one above if that is named for the camera."""
    folder = footage.parent
    return folder.parent.name if footage_name(footage) == folder.name else folder.name


def _unknown_camera(name: str, size: tuple[int, int], rank: int) -> Camera:
    """Return a level camera in front of the origin that looks along y, beside the `rank` cameras added before it."""
    focal, (width, height) = _USUAL_FOCAL * max(size), size
    K = np.array([[focal, 0, (width - 1) / 2], [0, focal, (height - 1) / 2], [0, 0, 1]])
    R = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])
    return Camera.create(name, size, K, R, -R @ np.array([0.5 * rank, -5.0, 1.0]))


def calibrate_views(
    current: bpy.types.Scene,
    cameras: Mapping[str, Camera],
    names: Sequence[str] | None = None,
    *,
    resized: bool = False,
) -> Calibrated:
    """Give views the calibrated cameras that match their names, see `core.shot.name_matching.paired`.

    Nothing is changed if an error is raised.

    Parameters
    ----------
    current : bpy.types.Scene
    cameras : mapping of str to Camera
    names : sequence of str, optional
        Names of the views to calibrate; by default all.
    resized : bool
        Whether the footage may have been resized, uncropped, after calibrating: the cameras are scaled to its size.

    Raises
    ------
    CalibrationError
        No camera matches a view, or the view's camera object is missing.
    FootageError
        A camera was calibrated for another size than that of the footage.
    """
    slots = {slot.name: slot for slot in current.kfmocap.views if names is None or slot.name in names}
    pairs = paired(list(slots), list(cameras))
    if not pairs:
        raise CalibrationError(
            f"the cameras ({', '.join(cameras)}) have other names than the views ({', '.join(slots)})",
            todo="enter the camera of each view in Look Through > View > Camera",
        )
    found = {name: _camera_of(slots[name], cameras[own], resized=resized) for name, own in pairs.items()}
    camera_poses.check_can_be_placed(slots[name] for name in pairs)
    for name, camera in found.items():
        _calibrate(current, slots[name], camera)
    footage_background.refresh(current)
    return Calibrated(tuple(pairs.values()), tuple(name for name in slots if name not in pairs))


def _camera_of(slot: bpy.types.PropertyGroup, camera: Camera, *, resized: bool) -> Camera:
    """Return a calibrated camera at the size of a view's footage."""
    if slot.camera is None:
        raise CalibrationError("the camera object is gone from the scene", where=f"view {slot.name}")
    with located(f"view {slot.name}"):
        size = (slot.size[0], slot.size[1])
        return camera_at_size(camera, size, resized=resized, declare="import with Resized Footage")


def _calibrate(current: bpy.types.Scene, slot: bpy.types.PropertyGroup, camera: Camera) -> None:
    view_cameras.show_camera(slot, camera, current.kfmocap.frame_start)
    slot.name, slot.calibrated, slot.lens_known = camera.name, True, True
    slot.camera.name = slot.camera.data.name = camera.name


def calibrated_by_scene(current: bpy.types.Scene, names: Sequence[str]) -> tuple[str, ...]:
    """Calibrate what can be with the scene's cameras, see `use_scene_cameras`; returns the views' names."""
    with contextlib.suppress(CalibrationError, FootageError):
        return use_scene_cameras(current, names).views
    return ()


def use_scene_cameras(current: bpy.types.Scene, names: Sequence[str] | None = None) -> Calibrated:
    """Calibrate views, by name, from camera objects that are not views themselves.

    Such cameras come from Calibrate, from Import Cameras or from Blender's own tracker. If the scene has no views yet,
    those with footage become views.

    Raises
    ------
    CalibrationError
        There is no such camera, or none matches a view.
    FootageError
        A camera was calibrated for another size than that of the footage.
    """
    owners = spare_cameras(current)
    if not owners:
        todo = "import a calibration, or calibrate with a wand"
        raise CalibrationError(
            "the scene has no calibrated camera that is not a view", where=f"scene {current.name}", todo=todo
        )
    if not current.kfmocap.views:
        return _adopted(current, owners)
    properties = current.kfmocap
    read = scene_cameras.read_cameras(current, owners, properties.frame_start, max(properties.length, 1))
    done = calibrate_views(current, {_plain(c.name): replace(c, name=_plain(c.name)) for c in read}, names)
    solved_cameras.forget([o for o in owners if _plain(o.name) in done.views], current)
    return done


def spare_cameras(current: bpy.types.Scene) -> list[bpy.types.Object]:
    """Return calibrated camera objects that are not views: those of this add-on, else all with footage behind them.

    The camera of Blender's default scene is neither.
    """
    own = [slot.camera for slot in current.kfmocap.views]
    spare = [owner for owner in current.objects if owner.type == "CAMERA" and owner not in own]
    ours = [
        owner for owner in solved_cameras.camera_objects(current) if owner in spare and scene_cameras.is_built(owner)
    ]
    return ours or [
        owner for owner in spare if scene_cameras.is_built(owner) or footage_background.clip_behind(owner) is not None
    ]


def _plain(name: str) -> str:
    """Return a name without the suffix, such as .001, that Blender adds if the name is taken."""
    stem, dot, number = name.rpartition(".")
    return stem if dot and number.isdigit() and len(number) == 3 else name


def _adopted(current: bpy.types.Scene, owners: Sequence[bpy.types.Object]) -> Calibrated:
    with_footage = [owner for owner in owners if footage_background.clip_behind(owner) is not None]
    if not with_footage:
        todo = "add the footage first: it is then given these cameras"
        raise ShotError("no camera of the scene has footage behind it", where=f"scene {current.name}", todo=todo)
    properties = current.kfmocap
    properties.shot = properties.shot or Path(bpy.data.filepath).stem or _UNNAMED
    clips = [footage_background.clip_behind(owner) for owner in with_footage]
    ends = [c.frame_start - c.frame_offset + c.frame_duration - 1 for c in clips if c.frame_duration > 1]
    start = current.frame_start
    end = min([current.frame_end, *(end for end in ends if end > start)])
    properties.zero, properties.first, properties.last = start, 0, max(end - start, 0)
    for owner in with_footage:
        view_cameras.adopt(properties.views.add(), owner, current)
    footage_background.look_through(current, properties.views[0])
    return Calibrated(tuple(slot.name for slot in properties.views), ())


def remove_view(current: bpy.types.Scene, index: int) -> None:
    """Remove a view from the shot, with its camera and footage unless something else uses them."""
    slots = current.kfmocap.views
    owner = slots[index].camera
    slots.remove(index)
    if owner is not None and not _is_of_another_scene(current, owner):
        _remove_camera(owner)
    if slots:
        footage_background.look_through(current, slots[min(index, len(slots) - 1)])


def _is_of_another_scene(current: bpy.types.Scene, owner: bpy.types.Object) -> bool:
    """Whether a camera is in another scene, or a view of one: scenes can be copied with their shots."""
    others = [other for other in bpy.data.scenes if other != current]
    return any(owner.name in o.objects or any(slot.camera == owner for slot in o.kfmocap.views) for o in others)


def _remove_camera(owner: bpy.types.Object) -> None:
    clip = footage_background.clip_behind(owner)
    data = owner.data
    bpy.data.objects.remove(owner)
    if data.users == 0:
        bpy.data.cameras.remove(data)
    shown = {image.clip for camera in bpy.data.cameras for image in camera.background_images}
    if clip is not None and clip.users == 0 and clip not in shown:
        bpy.data.movieclips.remove(clip)


def restore_camera(current: bpy.types.Scene, slot: bpy.types.PropertyGroup) -> None:
    """Bring a view's camera back into the scene that it was deleted from."""
    scene.ensure_collection(current, "Views").objects.link(slot.camera)
    if current.camera is None:
        footage_background.look_through(current, slot)
    footage_background.refresh(current)
