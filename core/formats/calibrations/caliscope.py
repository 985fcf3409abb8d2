"""Caliscope's calibration files (camera_array.toml); `read_toml_cameras` reads them."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ...cameras.camera import Camera
from ...numerics import rotations
from ...runtime.output_files.files import replacing

_COEFFICIENTS = 5  # of distortion, in a file


def write_caliscope_cameras(path: Path, cameras: Sequence[Camera]) -> None:
    """Write one table per numbered camera, with all fields that Caliscope writes."""
    numbers = [re.fullmatch(r"(?:cam|camera|port)?_?0*(\d+)", camera.name.lower()) for camera in cameras]
    keys = [int(n[1]) for n in numbers if n]
    if len(set(keys)) < len(cameras):
        keys = list(range(1, len(cameras) + 1))
    tables = [
        f"[cameras.{key}]\ncam_id = {key}\nport = {key}\nsize = {list(camera.size)}\nrotation_count = 0\n"
        f'error = "null"\nexposure = "null"\ngrid_count = "null"\nignore = false\nfisheye = false\n'
        f"matrix = {camera.matrix.tolist()}\ndistortions = {_five_coefficients(camera)}\n"
        f"translation = {camera.t_cam_world[0].tolist()}\nrotation = {rotations.log(camera.R_cam_world[0]).tolist()}\n"
        for key, camera in zip(keys, cameras, strict=True)
    ]
    with replacing(path) as temporary:
        temporary.write_text("\n".join(tables), encoding="utf-8")


def _five_coefficients(camera: Camera) -> list[float]:
    return [float(k) for k in np.pad(camera.distortions, (0, _COEFFICIENTS))[:_COEFFICIENTS]]
