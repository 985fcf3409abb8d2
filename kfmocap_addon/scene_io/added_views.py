"""Views added to a scene one by one: footage first, its camera's calibration when it is there."""

from __future__ import annotations

import contextlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import bpy
import numpy as np

from ...core.cameras.camera import Camera, same_proportions
from ...core.errors import CalibrationError, FootageError, ShotError
from ...core.shot.footage import Footage, probe
from ...core.shot.name_matching import footage_name, footage_of, paired
from ...core.shot.shot import View
from . import camera_poses, footage_background, scene, scene_cameras, solved_cameras, view_cameras

_USUAL_FOCAL = 1.1
"""Of a camera that nothing is known of, in longer sides of its picture."""
_UNNAMED = "shot"


@dataclass(frozen=True)
class Calibrated:
    """What became of views that were to be calibrated: names of those that were, and of those without a camera."""

    views: tuple[str, ...]
    left: tuple[str, ...]


def add_footage(current: bpy.types.Scene, files: Sequence[Path]) -> list[str]:
    """Add views of footage: cameras of which nothing is known yet, each before its footage.

    The first footage of a scene gives it the frame rate, and the shot its frames and its name.

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
        Some cannot be read, or is there already. Nothing was added then.
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
    if not current.kfmocap.views:
        _begin_shot(current, probed)
    collection = scene.ensure_collection(current, "Views")
    names = []
    for footage, clip in zip(probed, clips, strict=True):
        slots = current.kfmocap.views
        camera = _unknown_camera(scene.free_name(footage_name(footage.path), slots), footage.size, len(slots))
        properties, slot = current.kfmocap, slots.add()
        view_cameras.build_view(
            View(camera, footage.path),
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


def _begin_shot(current: bpy.types.Scene, probed: Sequence[Footage]) -> None:
    properties = current.kfmocap
    scene.set_rate(current, next((footage.fps for footage in probed if footage.fps > 0), None))
    saved = Path(bpy.data.filepath).stem
    properties.shot = properties.shot or saved or _folder_name(probed[0].path) or _UNNAMED
    properties.zero, properties.first = scene.FRAME_START, 0
    properties.last = max(min(footage.count for footage in probed) - 1, 0)
    current.frame_set(scene.FRAME_START)


def _folder_name(footage: Path) -> str:
    """The name of the folder that a shot's footage is in: images of one camera are in a folder that is named for it."""
    folder = footage.parent
    return folder.parent.name if footage_name(footage) == folder.name else folder.name


def _unknown_camera(name: str, size: tuple[int, int], rank: int) -> Camera:
    """A camera that stands before the origin and looks along y, level, beside those that came before it."""
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
    """Give views the calibrations that go by their names, see `core.shot.name_matching.paired`.

    Parameters
    ----------
    names : sequence of str, optional
        Of the views that are meant; by default all.
    resized : bool
        Whether footage was resized, uncropped, after the cameras were calibrated: they are scaled to its size.

    Raises
    ------
    CalibrationError
        No camera goes with a view, or one is of another size than the footage. Nothing was changed then.
    """
    slots = {slot.name: slot for slot in current.kfmocap.views if names is None or slot.name in names}
    pairs = paired(list(slots), list(cameras))
    if not pairs:
        raise CalibrationError(
            f"its cameras ({', '.join(cameras)}) go with none of the views ({', '.join(slots)})",
            todo="name the views as the cameras: click twice on a view's name in the list",
        )
    found = {name: _camera_of(slots[name], cameras[own], resized=resized) for name, own in pairs.items()}
    camera_poses.check_can_be_placed(slots[name] for name in pairs)
    for name, camera in found.items():
        _calibrate(current, slots[name], camera)
    footage_background.refresh(current)
    return Calibrated(tuple(pairs.values()), tuple(name for name in slots if name not in pairs))


def _camera_of(slot: bpy.types.PropertyGroup, camera: Camera, *, resized: bool) -> Camera:
    """A calibrated camera at the size of a view's footage."""
    if slot.camera is None:
        raise CalibrationError("the camera object is gone from the scene", where=f"view {slot.name}")
    size = (slot.size[0], slot.size[1])
    if size == camera.size:
        return camera
    alike = same_proportions(size, camera.size)
    if resized and alike:
        return camera.resized(size)
    (width, height), (own_width, own_height) = camera.size, size
    raise CalibrationError(
        f"the calibration of '{camera.name}' is for {width}x{height}, the footage is {own_width}x{own_height}",
        where=f"view {slot.name}",
        todo="if it was resized after calibrating, import with Resized Footage" if alike else "calibrate at that size",
    )


def _calibrate(current: bpy.types.Scene, slot: bpy.types.PropertyGroup, camera: Camera) -> None:
    view_cameras.show_camera(slot, camera, current.kfmocap.frame_start)
    slot.name, slot.calibrated, slot.lens_known = camera.name, True, True
    slot.camera.name = slot.camera.data.name = camera.name


def calibrated_by_scene(current: bpy.types.Scene, names: Sequence[str]) -> tuple[str, ...]:
    """Names of those views that cameras of the scene could calibrate, see `use_scene_cameras`."""
    with contextlib.suppress(CalibrationError):
        return use_scene_cameras(current, names).views
    return ()


def use_scene_cameras(current: bpy.types.Scene, names: Sequence[str] | None = None) -> Calibrated:
    """Calibrate views from camera objects that are no views, by name; without views, those with footage become some.

    Such cameras are those that Calibrate solved, those that Import Cameras showed, and those of Blender's own tracker.

    Raises
    ------
    CalibrationError
        There is no such camera, or none goes with a view.
    """
    owners = _spare_cameras(current)
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


def _spare_cameras(current: bpy.types.Scene) -> list[bpy.types.Object]:
    """Calibrated camera objects that are no views: those of ours, else all with footage behind them.

    A camera of the scene that Blender starts with has neither.
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
    """A name without what Blender adds where it is taken."""
    stem, dot, number = name.rpartition(".")
    return stem if dot and number.isdigit() and len(number) == 3 else name


def _adopted(current: bpy.types.Scene, owners: Sequence[bpy.types.Object]) -> Calibrated:
    with_footage = [owner for owner in owners if footage_background.clip_behind(owner) is not None]
    if not with_footage:
        todo = "add the footage first: it is then given these cameras"
        raise ShotError("no camera of the scene has footage behind it", where=f"scene {current.name}", todo=todo)
    properties = current.kfmocap
    properties.shot = properties.shot or Path(bpy.data.filepath).stem or _UNNAMED
    properties.zero, last = current.frame_start, current.frame_end - current.frame_start
    properties.first, properties.last = 0, last
    for owner in with_footage:
        view_cameras.adopt(properties.views.add(), owner, current)
    footage_background.look_through(current, properties.views[0])
    return Calibrated(tuple(slot.name for slot in properties.views), ())


def remove_view(current: bpy.types.Scene, index: int) -> None:
    """Take a view out of the shot, with its camera and footage where nothing else uses them."""
    slot = current.kfmocap.views[index]
    owner = slot.camera
    current.kfmocap.views.remove(index)
    if owner is None:
        return
    clip = footage_background.clip_behind(owner)
    data = owner.data
    bpy.data.objects.remove(owner)
    if data.users == 0:
        bpy.data.cameras.remove(data)
    shown = {image.clip for camera in bpy.data.cameras for image in camera.background_images}
    if clip is not None and clip.users == 0 and clip not in shown:
        bpy.data.movieclips.remove(clip)
    if current.kfmocap.views:
        footage_background.look_through(current, current.kfmocap.views[min(index, len(current.kfmocap.views) - 1)])
