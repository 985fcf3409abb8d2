"""Calibration files of OpenCV's FileStorage (.yml, .yaml, .json).

Two layouts are read. EasyMocap's: a list `names`, and for each name K_name, dist_name, H_name and W_name (its
size), R_name (Rodrigues) or Rot_name (matrix), and T_name, in one file or in extri.yml beside intri.yml. The
other: one node per camera, or one camera alone in the file, with the fields of OpenCV's calibration sample,
camera_matrix, distortion_coefficients, image_width and image_height, and its pose as rotation or R and
translation or T.
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from ...cameras.camera import Camera
from ...errors import CalibrationError
from ...numerics.arrays import Array
from ...runtime.output_files.files import replacing
from ..reading import check_depth, read_text, reading
from .lens_fields import is_fisheye
from .pose_fields import camera_poses

_MATRIX = ("camera_matrix", "matrix", "K", "intrinsics", "cameraMatrix")
_DISTORTIONS = ("distortion_coefficients", "distortions", "dist", "distCoeffs", "D")
_ROTATION = ("rotation", "R", "Rot", "rvec", "rotation_matrix")
_LONG_WORD = re.compile(r"\S{250}")
_BARE_KEY = re.compile(r"\s*(-\s+)*[^\s\[{].*:\s*(!\S*)?\s*")
_LONG_INTEGER = re.compile(r"(?<![^\s\[,:])[-+]?\d{10,}(?=[\s,\]]|$)")
_LONG_HEXADECIMAL = re.compile(r"(?<![^\s\[,:])[-+]?0[xX]\w{8,}")
_MAX_VALUES = 10_000  # values of a list or a matrix
_TRANSLATION = ("translation", "T", "t", "tvec")


def read_opencv_cameras(path: Path) -> list[Camera]:
    """Read the cameras of an OpenCV file.

    Raises
    ------
    CalibrationError
        The file cannot be read or a camera lacks a field; names the file, the camera and the field.
    """
    document = _document(path)
    if "names" in document:
        return [_camera(name, _easymocap(document, name), path) for name in _easymocap_names(document, path)]
    if any(key in document for key in _MATRIX):
        name = str(document.get("name", path.name.split(".")[0]))
        return [_camera(name, document, path)]
    tables = {k: v for k, v in document.items() if isinstance(v, dict) and any(m in v for m in _MATRIX)}
    return [_camera(str(table.get("name", key)), table, path) for key, table in tables.items()]


def _document(path: Path) -> dict[str, Any]:
    """Read the whole file as plain values: dict, list, str, numbers and arrays."""
    text = read_text(path, "the calibration", CalibrationError)
    check_depth(text, path, "an OpenCV file", CalibrationError)
    with reading(path, "an OpenCV file", CalibrationError):
        document = _of_json(json.loads(text)) if text.lstrip().startswith("{") else _of_yaml(text)
    if not isinstance(document, dict):
        raise CalibrationError("is not an OpenCV file", where=str(path))
    return document


def _of_json(value: Any) -> Any:
    """Convert a parsed JSON document, with matrices as arrays."""
    if isinstance(value, dict):
        if value.keys() >= {"rows", "cols", "data"}:
            return np.array(value["data"], float).reshape(int(value["rows"]), int(value["cols"]))
        return {key: _of_json(inner) for key, inner in value.items()}
    return [_of_json(inner) for inner in value] if isinstance(value, list) else value


def _of_yaml(text: str) -> Any:
    _check_yaml(text)
    storage = cv2.FileStorage()
    try:
        # OpenCV hangs on an integer of more than 32 bits, such as a time in milliseconds, but reads it as a float.
        opened = storage.open(_LONG_INTEGER.sub(r"\g<0>.", text), cv2.FILE_STORAGE_READ | cv2.FILE_STORAGE_MEMORY)
        return _value(storage.root()) if opened else None
    finally:
        storage.release()


def _check_yaml(text: str) -> None:
    """Check for what crashes OpenCV's parser: keys without a value, and very long words.

    Raises
    ------
    ValueError
        The text has one of these.
    """
    if not text.startswith("%YAML"):
        raise ValueError("it begins neither with %YAML:1.0, as OpenCV writes it, nor as JSON")
    if _LONG_WORD.search(text):
        raise ValueError("a word in it is too long")
    if _LONG_HEXADECIMAL.search(text):
        raise ValueError("a hexadecimal number in it is too long")
    lines = [line for line in text.split("\n") if line.strip() and not line.lstrip().startswith("#")]
    for line, following in zip(lines, [*lines[1:], ""], strict=True):
        if _BARE_KEY.fullmatch(line):
            deeper = _indentation(following) - _indentation(line)
            if not (deeper > 0 or (deeper == 0 and following.lstrip().startswith("- "))):
                raise ValueError(f"'{line.strip()[:40]}' has no value")


def _indentation(line: str) -> int:
    return len(line) - len(line.lstrip(" "))


def _value(node: Any) -> Any:
    if node.isMap():
        keys = node.keys()
        if "dt" in keys and "data" in keys:
            return _matrix(node)
        return {key: _value(node.getNode(key)) for key in keys}
    if node.isSeq():
        if node.size() > _MAX_VALUES:  # `at` steps through all elements before, so this is quadratic
            raise ValueError(f"a list of {node.size()} values")
        return [_value(node.at(i)) for i in range(node.size())]
    if node.isString():
        return node.string()
    return node.real() if node.isReal() or node.isInt() else None


def _matrix(node: Any) -> Any:
    """Return a matrix, if it has as many values as it states: OpenCV allocates memory for the stated number."""
    rows, columns, kind = (node.getNode(key) for key in ("rows", "cols", "dt"))
    claimed, data = rows.real() * columns.real(), node.getNode("data")
    if re.fullmatch("[ucwsifdh]", kind.string()) is None or not 0 < claimed <= _MAX_VALUES:
        raise ValueError(f"a matrix of {rows.real():.0f} x {columns.real():.0f} values of type {kind.string()[:20]}")
    if data.isSeq() and data.size() != claimed:
        raise ValueError(f"a matrix of {rows.real():.0f} x {columns.real():.0f} has {data.size()} values")
    return node.mat()


def _easymocap_names(document: dict[str, Any], path: Path) -> list[str]:
    """Return the names in the file; if it is intri.yml, the poses in extri.yml are added to `document`."""
    extrinsics = path.with_name(path.name.replace("intri", "extri").replace("Intri", "Extri"))
    if extrinsics != path and extrinsics.is_file():
        for key, value in _document(extrinsics).items():
            document.setdefault(key, value)
    return [str(int(n)) if isinstance(n, float) else str(n) for n in document["names"]]


def _easymocap(document: Mapping[str, Any], name: str) -> dict[str, Any]:
    keys = {"K": "K", "dist": "dist", "Rot": "R", "T": "T", "W": "image_width", "H": "image_height"}
    if f"Rot_{name}" not in document:
        keys["R"] = keys.pop("Rot")
    return {ours: document[f"{key}_{name}"] for key, ours in keys.items() if f"{key}_{name}" in document}


def _camera(name: str, table: Mapping[str, Any], path: Path) -> Camera:
    where = f"{path} camera {name}"
    known = any(key in table for key in _DISTORTIONS)
    distortions = _field(table, _DISTORTIONS, where) if known else np.zeros(4)
    R, t = camera_poses(_field(table, _ROTATION, where), _field(table, _TRANSLATION, where), where)
    return Camera.create(
        name,
        _size(table, where),
        _shaped(_field(table, _MATRIX, where), (3, 3), "the matrix", where),
        R,
        t,
        distortions=distortions,
        fisheye=is_fisheye(table, where),
    )


def _field(table: Mapping[str, Any], names: tuple[str, ...], where: str) -> Array:
    for name in names:
        if name in table:
            try:
                return np.asarray(table[name], dtype=float).ravel()
            except (TypeError, ValueError) as error:
                raise CalibrationError(f"'{name}' must be numbers", where=where) from error
    raise CalibrationError(f"'{names[0]}' is missing", where=where, todo=f"also known as {', '.join(names[1:])}")


def _shaped(values: Array, shape: tuple[int, ...], what: str, where: str) -> Array:
    if values.size != np.prod(shape):
        raise CalibrationError(f"{what} has {values.size} numbers, not {np.prod(shape)}", where=where)
    return values.reshape(shape)


def _size(table: Mapping[str, Any], where: str) -> tuple[int, int]:
    if "image_width" in table and "image_height" in table:
        width, height = (_field(table, (key,), where) for key in ("image_width", "image_height"))
        return int(width[0]), int(height[0])
    for key in ("size", "image_size", "imageSize"):
        if key in table:
            values = _shaped(_field(table, (key,), where), (2,), "the size", where)
            return int(values[0]), int(values[1])
    todo = "add image_width and image_height, or W_name and H_name in EasyMocap's layout"
    raise CalibrationError("the size of its footage is missing", where=where, todo=todo)


def write_opencv_cameras(path: Path, cameras: Sequence[Camera]) -> None:
    """Write a node per camera with the fields of OpenCV's calibration sample, its rotation as a matrix."""
    with replacing(path) as temporary:
        # In memory: OpenCV reports neither why a file cannot be written nor that the disk is full.
        kind = cv2.FILE_STORAGE_FORMAT_JSON if path.suffix.lower() == ".json" else cv2.FILE_STORAGE_FORMAT_YAML
        storage = cv2.FileStorage("", cv2.FILE_STORAGE_WRITE | cv2.FILE_STORAGE_MEMORY | kind)
        for c, camera in enumerate(cameras, 1):
            key = camera.name if re.fullmatch(r"[A-Za-z_][A-Za-z0-9_-]*", camera.name) else f"camera_{c}"
            storage.startWriteStruct(key, cv2.FILE_NODE_MAP)
            storage.write("name", camera.name)
            storage.write("image_width", camera.size[0])
            storage.write("image_height", camera.size[1])
            storage.write("camera_matrix", camera.matrix)
            storage.write("distortion_coefficients", camera.distortions[None])
            storage.write("rotation", camera.R_cam_world[0])
            storage.write("translation", camera.t_cam_world[0][:, None])
            storage.write("fisheye", int(camera.fisheye))
            storage.endWriteStruct()
        temporary.write_text(storage.releaseAndGetString(), encoding="utf-8")
