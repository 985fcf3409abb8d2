"""Qualisys' calibration files (.qca.txt, an XML document).

The transform holds the camera's position (mm) and its rotation, column by column, with the camera looking along -z. Its
inverse, rotated by pi about x, is OpenCV's. Lengths on the sensor are in units of 1/64 pixel.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from ...cameras.camera import Camera
from ...errors import CalibrationError
from ...runtime.output_files.files import replacing
from ..reading import NUMBER_LIMIT, read_bytes, reading

_SUBPIXELS = 64.0  # to a pixel: units of the lengths in the file
_FLIP = np.diag([1.0, -1.0, -1.0])  # from axes with y up and z backwards to ours with y down and z forwards


def read_qualisys_cameras(path: Path) -> list[Camera]:
    """Read the video cameras of a .qca.txt file, named by their serial.

    Raises
    ------
    CalibrationError
        The file cannot be read or lacks a value; names the file, the camera and the value.
    """
    data = read_bytes(path, "the calibration", CalibrationError)
    with reading(path, "a Qualisys calibration", CalibrationError):
        root = ElementTree.fromstring(data)
    return [_camera(element, path) for element in root.iter("camera") if _films(element)]


def _films(element: ElementTree.Element) -> bool:
    """Whether an element is a video camera; the file also lists the system's marker cameras."""
    model = element.get("model", "none").lower()
    return element.get("active", "1") != "0" and ("video" in model or model == "none")


def _camera(element: ElementTree.Element, path: Path) -> Camera:
    name = element.get("serial", "")
    where = f"{path} camera {name}"

    def value(tag: str, key: str) -> float:
        child = element.find(tag)
        text = None if child is None else child.get(key)
        try:
            number = float(text or "")
        except ValueError:
            number = np.nan
        if not abs(number) <= NUMBER_LIMIT:
            found = "is missing" if text is None else f"is '{text[:40]}', not a number that can be meant"
            raise CalibrationError(f"{tag} {key} {found}", where=where)
        return number

    if element.get("viewrotation", "0") != "0":
        raise CalibrationError("a rotated view is not supported", where=where, todo="export with viewrotation 0")
    left, top = value("fov_video", "left"), value("fov_video", "top")
    size = (round(value("fov_video", "right") - left) + 1, round(value("fov_video", "bottom") - top) + 1)
    fu, fv, cu, cv, skew = (
        value("intrinsic", key) / _SUBPIXELS
        for key in ("focalLengthU", "focalLengthV", "centerPointU", "centerPointV", "skew")
    )
    K = np.array([[fu, skew, cu - left], [0.0, fv, cv - top], [0.0, 0.0, 1.0]])
    # Unlike the lengths, these apply to normalised coordinates: no 1/64. Qualisys spells it "tangental".
    radial, tangential = "radialDistortion", "tangentalDistortion"
    keys = (f"{radial}1", f"{radial}2", f"{tangential}1", f"{tangential}2", f"{radial}3")
    distortions = [value("intrinsic", key) for key in keys]
    rows = [[value("transform", f"r{i}{j}") for j in (1, 2, 3)] for i in (1, 2, 3)]
    centre = np.array([value("transform", key) for key in "xyz"]) / 1000
    R = _FLIP @ np.array(rows)
    return Camera.create(name, size, K, R, -R @ centre, distortions=distortions)


def write_qualisys_cameras(path: Path, cameras: Sequence[Camera]) -> None:
    """Write a .qca.txt file in which every camera is a video camera."""
    root = ElementTree.Element("calibration", type="regular")
    rows = ElementTree.SubElement(root, "cameras")
    for camera in cameras:
        rows.append(_element(camera))
    ElementTree.indent(root)
    with replacing(path) as temporary:
        ElementTree.ElementTree(root).write(temporary, encoding="utf-8", xml_declaration=True)


def _element(camera: Camera) -> ElementTree.Element:
    element = ElementTree.Element("camera", active="1", model="Video", serial=camera.name, viewrotation="0")
    width, height = camera.size
    for tag in ("fov_marker", "fov_marker_max", "fov_video", "fov_video_max"):
        ElementTree.SubElement(element, tag, left="0", top="0", right=str(width - 1), bottom=str(height - 1))
    R, K = _FLIP @ camera.R_cam_world[0], camera.matrix * _SUBPIXELS
    turn = {f"r{i + 1}{j + 1}": repr(float(R[i, j])) for i in range(3) for j in range(3)}
    place = {axis: repr(1000 * float(x)) for axis, x in zip("xyz", camera.centre_world(), strict=True)}
    ElementTree.SubElement(element, "transform", place | turn)
    k1, k2, p1, p2, k3 = np.pad(camera.distortions, (0, 5))[:5]
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
