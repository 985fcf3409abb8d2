"""Calibrations as other programs read them; `calibration.load_cameras` reads each of them back."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from xml.etree import ElementTree

import cv2
import numpy as np

from ..cameras.camera import Camera
from ..errors import CalibrationError
from ..numerics import rotations
from ..runtime.files import replacing
from .calibration_files import save_cameras
from .qualisys import FLIP, SUBPIXELS

_ENDINGS = {"toml": (".toml",), "qualisys": (".qca.txt", ".qca"), "opencv": (".yml", ".yaml", ".json")}
_COEFFICIENTS = 5
"""k1, k2, p1, p2, k3: what Qualisys and Caliscope have."""


def export_cameras(path: Path | str, cameras: Mapping[str, Camera] | Sequence[Camera], kind: str | None = None) -> None:
    """Write a calibration in the form that its name, or `kind`, asks for.

    Parameters
    ----------
    path : path
        .toml (aniposelib, Pose2Sim and ours are one), .qca.txt (Qualisys), .yml, .yaml or .json (OpenCV).
    cameras : mapping or sequence of Camera
    kind : str, optional
        One of `KINDS`; "caliscope" writes a .toml that differs from the usual one.

    Raises
    ------
    CalibrationError
        The kind is unknown, or has no place for what a camera has: it moves, is a fisheye, or has more coefficients.
    OutputError
        The file cannot be written.
    """
    path = Path(path)
    kind = check_kind(path, kind)
    values = list(cameras.values()) if isinstance(cameras, Mapping) else list(cameras)
    if kind != "toml":
        for camera in values:
            _check_plain(camera, kind)
    KINDS[kind](path, values)


def check_kind(path: Path, kind: str | None = None) -> str:
    """The kind that is asked for, by itself or by the file's name.

    Raises
    ------
    CalibrationError
        It is unknown.
    """
    if kind in KINDS:
        return kind
    if kind is not None:
        todo = f"there are {', '.join(KINDS)}"
        raise CalibrationError(f"unknown kind of calibration '{kind}'", where=str(path), todo=todo)
    name = path.name.lower()
    for kind, ends in (
        ("toml", (".toml",)),
        ("qualisys", (".qca.txt", ".qca")),
        ("opencv", (".yml", ".yaml", ".json")),
    ):
        if name.endswith(ends):
            return kind
    todo = "known are .toml, .qca.txt, .yml, .yaml and .json"
    raise CalibrationError("unknown kind of calibration", where=str(path), todo=todo)


def _check_plain(camera: Camera, kind: str) -> None:
    where = f"camera {camera.name}"
    if camera.moving:
        raise CalibrationError(f"{kind} has no moving cameras", where=where)
    if camera.fisheye and kind != "opencv":
        raise CalibrationError(f"{kind} has no fisheye lenses", where=where)
    if kind != "opencv" and camera.distortions[_COEFFICIENTS:].any():
        raise CalibrationError(f"{kind} has {_COEFFICIENTS} distortion coefficients, not more", where=where)


def _five(camera: Camera) -> list[float]:
    """The first five distortion coefficients."""
    return np.pad(camera.distortions, (0, _COEFFICIENTS))[:_COEFFICIENTS].tolist()


def _save_caliscope(path: Path, cameras: Sequence[Camera]) -> None:
    """One table per numbered camera, with the fields that Caliscope's camera_array.toml has."""
    numbers = [re.fullmatch(r"(?:cam|camera|port)?_?0*(\d+)", camera.name.lower()) for camera in cameras]
    keys = [int(n[1]) for n in numbers if n]
    if len(set(keys)) < len(cameras):
        keys = list(range(1, len(cameras) + 1))
    tables = [
        f"[cameras.{key}]\ncam_id = {key}\nport = {key}\nsize = {list(camera.size)}\nrotation_count = 0\n"
        f'error = "null"\nexposure = "null"\ngrid_count = "null"\nignore = false\nfisheye = false\n'
        f"matrix = {camera.matrix.tolist()}\ndistortions = {_five(camera)}\n"
        f"translation = {camera.t_cam_world[0].tolist()}\nrotation = {rotations.log(camera.R_cam_world[0]).tolist()}\n"
        for key, camera in zip(keys, cameras, strict=True)
    ]
    with replacing(path) as temporary:
        temporary.write_text("\n".join(tables), encoding="utf-8")


def _save_qualisys(path: Path, cameras: Sequence[Camera]) -> None:
    """An XML document; see `qualisys` for its conventions."""
    root = ElementTree.Element("calibration", type="regular")
    rows = ElementTree.SubElement(root, "cameras")
    for camera in cameras:
        rows.append(_qualisys_camera(camera))
    ElementTree.indent(root)
    with replacing(path) as temporary:
        ElementTree.ElementTree(root).write(temporary, encoding="utf-8", xml_declaration=True)


def _qualisys_camera(camera: Camera) -> ElementTree.Element:
    element = ElementTree.Element("camera", active="1", model="Video", serial=camera.name, viewrotation="0")
    width, height = camera.size
    for tag in ("fov_marker", "fov_marker_max", "fov_video", "fov_video_max"):
        ElementTree.SubElement(element, tag, left="0", top="0", right=str(width - 1), bottom=str(height - 1))
    R, K = FLIP @ camera.R_cam_world[0], camera.matrix * SUBPIXELS
    turn = {f"r{i + 1}{j + 1}": repr(float(R[i, j])) for i in range(3) for j in range(3)}
    place = {axis: repr(1000 * float(x)) for axis, x in zip("xyz", camera.centre_world(), strict=True)}
    ElementTree.SubElement(element, "transform", place | turn)
    k1, k2, p1, p2, k3 = _five(camera)
    values = {
        "focalLengthU": K[0, 0],
        "focalLengthV": K[1, 1],
        "centerPointU": K[0, 2],
        "centerPointV": K[1, 2],
        "skew": K[0, 1],
        "radialDistortion1": k1,
        "radialDistortion2": k2,
        "radialDistortion3": k3,
        "tangentalDistortion1": p1,
        "tangentalDistortion2": p2,
    }
    ElementTree.SubElement(element, "intrinsic", {key: repr(float(value)) for key, value in values.items()})
    return element


def _save_opencv(path: Path, cameras: Sequence[Camera]) -> None:
    """A node per camera with the fields of OpenCV's calibration sample, its rotation as a matrix."""
    with replacing(path) as temporary:
        temporary.touch()  # where that fails the error says why, which OpenCV's does not
        storage = cv2.FileStorage(str(temporary), cv2.FILE_STORAGE_WRITE)
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
        storage.release()


KINDS: dict[str, Callable[[Path, Sequence[Camera]], None]] = {
    "toml": save_cameras,
    "caliscope": _save_caliscope,
    "qualisys": _save_qualisys,
    "opencv": _save_opencv,
}
"""What writes each kind."""
