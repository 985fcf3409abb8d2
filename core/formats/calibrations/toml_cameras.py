"""KF Mocap's own calibration files (.toml), in the format of aniposelib and Pose2Sim; Caliscope's are read as well.

A camera is a table with name, size, matrix, distortions, rotation (Rodrigues vector) and translation (metres). A moving
camera's rotation and translation are lists of such vectors, one per frame of the shot; if its lens zooms, zooms says
how many times as long as in the matrix the focal lengths are on each. Other programs' files may give a rotation as a
3x3 matrix: see `core.formats.calibrations.pose_fields`.
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from ...cameras.camera import Camera
from ...errors import CalibrationError
from ...numerics import rotations
from ...numerics.arrays import Array
from ...runtime.output_files.files import replacing
from ..toml_tables import check_kind, read_toml
from .lens_fields import is_fisheye
from .pose_fields import camera_poses


def read_toml_cameras(path: Path) -> list[Camera]:
    """Read the cameras of a TOML calibration.

    Raises
    ------
    CalibrationError
        The file cannot be read or a camera lacks a field; names the file, the camera and the field.
    """
    document = read_toml(path, "the calibration", CalibrationError)
    check_kind(document, path, "calibration", CalibrationError)
    tables = {k: v for k, v in document.items() if isinstance(v, dict) and "matrix" in v}
    nested = document.get("cameras")  # Caliscope has tables [cameras.1], ... without names
    if isinstance(nested, dict):
        tables.update({f"cam_{k}": v for k, v in nested.items() if isinstance(v, dict) and "matrix" in v})
    return [_toml_camera(key, table, path) for key, table in tables.items() if _posed(table)]


def _posed(table: Mapping[str, Any]) -> bool:
    """Whether a camera has a pose; Caliscope's files also list cameras without one, with "null" for unknown values."""
    return all(table.get(key, "null") != "null" for key in ("matrix", "rotation", "translation"))


def _toml_camera(key: str, table: Mapping[str, Any], path: Path) -> Camera:
    name = str(table.get("name", key))
    where = f"{path} camera {name}"
    size = _numbers(table, "size", where, (2,))
    if not (size == size.round()).all() or not (size > 0).all():
        todo = "give the width and height of the footage"
        raise CalibrationError("size must be two whole numbers of pixels", where=where, todo=todo)
    for field in ("rotation", "translation"):
        if field not in table:
            raise CalibrationError(f"'{field}' is missing", where=where)
    camera = Camera.create(
        name,
        (int(size[0]), int(size[1])),
        _numbers(table, "matrix", where, (3, 3)),
        *camera_poses(table["rotation"], table["translation"], where),
        distortions=_numbers(table, "distortions", where, None) if "distortions" in table else (0.0, 0.0, 0.0, 0.0),
        fisheye=is_fisheye(table, where),
    )
    return replace(camera, zooms=_zooms(table, where, len(camera.R_cam_world))) if "zooms" in table else camera


def _zooms(table: Mapping[str, Any], where: str, poses: int) -> Array:
    zooms = _numbers(table, "zooms", where, (poses,))
    if not ((zooms >= 0.01) & (zooms <= 100)).all():
        raise CalibrationError("'zooms' must lie between 0.01 and 100", where=where)
    return zooms


def _numbers(table: Mapping[str, Any], key: str, where: str, shape: tuple[int, ...] | None) -> Array:
    """Return the array of one field with the given shape; None stands for a vector, which may also be a row or
    column.
    """
    if key not in table:
        raise CalibrationError(f"'{key}' is missing", where=where)
    try:
        values = np.asarray(table[key], dtype=float)
    except (TypeError, ValueError) as error:
        raise CalibrationError(f"'{key}' must be numbers", where=where) from error
    if shape is None and values.ndim == 2 and 1 in values.shape:
        values = values.ravel()
    if (values.ndim != 1) if shape is None else (values.shape != shape):
        wanted = "a list" if shape is None else " x ".join(map(str, shape))
        raise CalibrationError(f"'{key}' has shape {values.shape}, not {wanted}", where=where)
    if not np.isfinite(values).all():
        raise CalibrationError(f"'{key}' holds a value that is not a finite number", where=where)
    return values


def save_cameras(path: Path | str, cameras: Mapping[str, Camera] | Sequence[Camera]) -> None:
    """Write cameras as TOML; `load_cameras` reads the same cameras back.

    Raises
    ------
    OutputError
        The file cannot be written.
    """
    values = list(cameras.values()) if isinstance(cameras, Mapping) else list(cameras)
    head = (
        "# OpenCV convention: x_cam = R x_world + t, metres, Z-up world, pixel centres at integers;\n"
        "# rotation is a Rodrigues vector; lists of vectors are the poses of a moving camera, one a frame.\n"
    )
    with replacing(Path(path)) as temporary:
        temporary.write_text("\n".join([head, *map(_toml_table, values)]), encoding="utf-8")


def _toml_table(camera: Camera) -> str:
    key = camera.name if re.fullmatch(r"[A-Za-z0-9_-]+", camera.name) else _quoted(camera.name)
    rotation, translation = rotations.log(camera.R_cam_world), camera.t_cam_world
    if not camera.moving:
        rotation, translation = rotation[0], translation[0]
    return (
        f"[{key}]\nname = {_quoted(camera.name)}\nsize = {list(camera.size)}\n"
        f"matrix = {camera.matrix.tolist()}\ndistortions = {camera.distortions.tolist()}\n"
        f"rotation = {rotation.tolist()}\ntranslation = {translation.tolist()}\n"
        f"fisheye = {str(camera.fisheye).lower()}\n"
    ) + ("" if camera.zooms is None else f"zooms = {camera.zooms.tolist()}\n")


def _quoted(text: str) -> str:
    """Return a TOML basic string, whose escapes include all of JSON's."""
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")
