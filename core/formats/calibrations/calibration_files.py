"""Calibration files of every program that KF Mocap reads and writes."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import chain
from pathlib import Path

from ...cameras.camera import Camera
from ...choices import CALIBRATION_ENDINGS
from ...errors import CalibrationError
from ...numerics.sequences import first_repeated
from ..reading import NUMBER_LIMIT, reading
from .caliscope import write_caliscope_cameras
from .opencv_storage import read_opencv_cameras, write_opencv_cameras
from .qualisys import read_qualisys_cameras, write_qualisys_cameras
from .toml_cameras import read_toml_cameras, save_cameras

_OTHERS = {
    ".xcp": "Pose2Sim converts Vicon's .xcp to its .toml",
    ".pickle": "Pose2Sim converts OpenCap's .pickle to its .toml",
    ".xml": "with OpenCV write .yml; of Qualisys or Theia, let the name end in .qca.txt",
    ".txt": "of Qualisys or Theia, let the name end in .qca.txt",
    ".blend": "export the cameras from Blender: section Calibration of the KF Mocap tab",
}
"""What to do with files of other programs, by the endings of their names."""
_MAX_SIDE = 100_000  # pixels
_LEAST_FOCAL_SHARE = 0.05
"""Focal length, as a share of the picture's longer side, that no lens is shorter than: fisheyes of 180 degrees have a
third."""


@dataclass(frozen=True)
class CalibrationFormat:
    """A kind of calibration file, and what it can store.

    Attributes
    ----------
    programs : str
        The programs that use it, for error messages.
    read : callable
        Called with a path; returns a list of Camera.
    write : callable
        Called with a path and a sequence of Camera.
    moving, fisheye : bool
        Whether it can store moving cameras, also those that zoom, and fisheye lenses.
    coefficients : int or None
        Number of distortion coefficients that it can store; None for any number.
    """

    programs: str
    read: Callable[[Path], list[Camera]]
    write: Callable[[Path, Sequence[Camera]], None]
    moving: bool = False
    fisheye: bool = False
    coefficients: int | None = 5


FORMATS = {
    "toml": CalibrationFormat(
        "aniposelib, Pose2Sim, Caliscope",
        read_toml_cameras,
        save_cameras,
        moving=True,
        fisheye=True,
        coefficients=None,
    ),
    "caliscope": CalibrationFormat("Caliscope", read_toml_cameras, write_caliscope_cameras),
    "qualisys": CalibrationFormat("Qualisys", read_qualisys_cameras, write_qualisys_cameras),
    "opencv": CalibrationFormat("OpenCV", read_opencv_cameras, write_opencv_cameras, fisheye=True, coefficients=None),
}
"""The formats by their names, which are those of `core.choices.CALIBRATION_ENDINGS`."""


def load_cameras(path: Path | str) -> dict[str, Camera]:
    """Read the cameras of a calibration file, by name.

    Raises
    ------
    CalibrationError
        The file cannot be read, or a camera in it is incomplete; names the file, the camera and the field.
    """
    path = Path(path)
    try:
        known = FORMATS[format_name(path)]
    except CalibrationError as error:
        todo = _OTHERS.get(path.suffix.lower(), error.todo)
        raise CalibrationError(error.what, where=error.where, todo=todo) from error
    with reading(path, f"a calibration of {known.programs}", CalibrationError):
        cameras = known.read(path)
    if not cameras:
        todo = "each camera needs its matrix, rotation and translation in a table of its own"
        raise CalibrationError("the calibration holds no camera with a pose", where=str(path), todo=todo)
    for camera in cameras:
        _check_distortions(camera, f"{path} camera {camera.name}")
        _check_measures(camera, f"{path} camera {camera.name}")
    if (twice := first_repeated(camera.name for camera in cameras)) is not None:
        raise CalibrationError(f"camera '{twice}' is there twice", where=str(path))
    return {camera.name: camera for camera in cameras}


def export_cameras(path: Path | str, cameras: Mapping[str, Camera] | Sequence[Camera], kind: str | None = None) -> None:
    """Write a calibration file; `load_cameras` reads the same cameras back.

    Parameters
    ----------
    path : path
    cameras : mapping or sequence of Camera
    kind : str, optional
        One of `FORMATS`; by default the first one with the path's ending.

    Raises
    ------
    CalibrationError
        The format is unknown or cannot store a camera.
    OutputError
        The file cannot be written.
    """
    path = Path(path)
    name = format_name(path, kind)
    values = list(cameras.values()) if isinstance(cameras, Mapping) else list(cameras)
    for camera in values:
        _check_storable(camera, name)
    FORMATS[name].write(path, values)


def format_name(path: Path, kind: str | None = None) -> str:
    """Name the format of `FORMATS` that is asked for, either by itself or by the path's ending.

    Raises
    ------
    CalibrationError
        There is no such format.
    """
    if kind is not None:
        if kind in FORMATS:
            return kind
        todo = f"there are {', '.join(FORMATS)}"
        raise CalibrationError(f"unknown kind of calibration '{kind}'", where=str(path), todo=todo)
    for name, endings in CALIBRATION_ENDINGS.items():
        if path.name.lower().endswith(endings):
            return name
    known_endings = dict.fromkeys(chain.from_iterable(CALIBRATION_ENDINGS.values()))
    programs = ", ".join(dict.fromkeys(program for known in FORMATS.values() for program in known.programs.split(", ")))
    todo = f"known are {', '.join(known_endings)} of {programs}"
    raise CalibrationError("unknown kind of calibration", where=str(path), todo=todo)


def _check_distortions(camera: Camera, where: str) -> None:
    """Raise an error for a number of coefficients that OpenCV does not support."""
    counts = (4,) if camera.fisheye else (4, 5, 8, 12, 14)
    if len(camera.distortions) not in counts:
        wanted = " or ".join(map(str, counts))
        raise CalibrationError(f"{len(camera.distortions)} distortions, not {wanted}", where=where)


def _check_measures(camera: Camera, where: str) -> None:
    """Raise an error for impossible values, such as a width of 0 or a position beyond all bounds."""
    if not all(0 < side <= _MAX_SIDE for side in camera.size):
        todo = "give the width and height of the footage"
        raise CalibrationError(f"a picture of {camera.size[0]} x {camera.size[1]} pixels", where=where, todo=todo)
    if (focal := min(camera.matrix[0, 0], camera.matrix[1, 1])) < _LEAST_FOCAL_SHARE * max(camera.size):
        what = f"a focal length of {focal:.4g} pixels, shorter than any lens's"
        raise CalibrationError(what, where=where, todo="if it is in millimetres, give the matrix in pixels")
    for what, values in (("matrix", camera.matrix), ("translation", camera.t_cam_world)):
        if not (abs(values) <= NUMBER_LIMIT).all():
            raise CalibrationError(f"the {what} holds a number too large to be true", where=where)


def _check_storable(camera: Camera, name: str) -> None:
    known, where = FORMATS[name], f"camera {camera.name}"
    if camera.moving and not known.moving:
        raise CalibrationError(f"{name} has no moving cameras", where=where)
    if camera.zooms is not None and not known.moving:
        raise CalibrationError(f"{name} has no lenses that zoom", where=where)
    if camera.fisheye and not known.fisheye:
        raise CalibrationError(f"{name} has no fisheye lenses", where=where)
    if known.coefficients is not None and camera.distortions[known.coefficients :].any():
        raise CalibrationError(f"{name} has {known.coefficients} distortion coefficients, not more", where=where)
